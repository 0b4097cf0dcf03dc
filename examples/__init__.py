"""The paper's figures and trade-offs, a short script each: `python -m examples.figure_a`; `make figures`."""
