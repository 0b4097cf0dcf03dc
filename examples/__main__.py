"""`python -m examples`: draw every figure of the docs; with names, `figure_a drift`, only those.

`flows` are the small pictures of all flows, drawn only by that name.
"""

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
    unknown = sorted(set(sys.argv[1:]) - {*FIGURES, "flows"})
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such figure; there are {', '.join(FIGURES)}")
    for name in sys.argv[1:] or FIGURES:
        draw(name)


def draw(name: str) -> None:
    """Draw a figure; leave it out, and say so, where a plug-in that it needs is not installed."""
    try:
        figure = import_module(f"examples.{name}")
    except ModuleNotFoundError as error:
        package, _, plugin = str(error.name).rpartition(".")
        if package != "flowsculpt.pipeline.plugins":
            raise
        print(f"{name} is left out: it needs the plug-in {plugin}, which is not installed")
    else:
        figure.draw()


if __name__ == "__main__":
    main()
