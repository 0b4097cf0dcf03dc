"""Figures of the paper and its trade-offs, one script each: `python -m examples.figure_a`; `make figures`."""
