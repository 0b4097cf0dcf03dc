"""`python -m examples`: draw every figure of the docs; with names, `figure_a drift`, only those."""

from __future__ import annotations

import sys
from importlib import import_module

FIGURES = (
    "figure_a",
    "figure_b",
    "figure_c",
    "figure_d",
    "figure_e",
    "figure_f",
    "mesh_likeness",
    "density",
    "hysteresis",
    "low_pass",
    "tendril",
    "placements",
    "drift",
    "splitting",
    "corner_table",
)


def main() -> None:
    unknown = sorted(set(sys.argv[1:]) - set(FIGURES))
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such figure; there are {', '.join(FIGURES)}")
    for name in sys.argv[1:] or FIGURES:
        import_module(f"examples.{name}").draw()


if __name__ == "__main__":
    main()
