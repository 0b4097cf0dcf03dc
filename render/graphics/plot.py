"""Write pages of plots over frames with matplotlib, one panel above another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from render.base.atomic_write import atomic_write
from render.base.errors import BadInputError
from render.graphics.panels import FAINT, GREY, INK, Panel, draw_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".png", ".pdf")

PAGE_WIDTH, PANEL_HEIGHT, TOP, BOTTOM = 9.6, 1.25, 0.7, 0.5
"""Inches: the page, a panel with its name, and the margins with the title and the frame numbers."""

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.solid_capstyle": "round",
    "svg.hashsalt": "flowsculpt",
}
"""Fonts and lines of pages of plots and of the figures in the docs."""


def plot_panels(title: str, panels: Sequence[Panel], fps: float, path: Path) -> None:
    """Write a page of panels over the same frames, as SVG, PNG or PDF; the same bytes every time.

    Raises BadInputError for another ending or no panels, MachineError where the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise BadInputError(f"{path}: a page of curves can be {', '.join(ENDINGS)}; end its name so")
    if not panels:
        raise BadInputError("a page of no curves is not possible")
    import matplotlib as mpl

    with mpl.rc_context(STYLE), atomic_write(path) as temporary:
        figure = _page(title, panels, fps)
        kind = path.suffix.lower().lstrip(".")
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        figure.savefig(temporary, format=kind, dpi=110, metadata=metadata)


def _page(title: str, panels: Sequence[Panel], fps: float) -> Figure:
    from matplotlib.figure import Figure

    height = TOP + BOTTOM + PANEL_HEIGHT * len(panels)
    figure = Figure(figsize=(PAGE_WIDTH, height), facecolor="white")
    figure.text(0.075, 1.0 - 0.3 / height, title, size=12, weight="bold", va="center")
    first, last = float(panels[0].frames[0]), float(panels[0].frames[-1])
    drawn: list[Axes] = []
    for i, panel in enumerate(panels):
        bottom = BOTTOM + PANEL_HEIGHT * (len(panels) - 1 - i)
        box = (0.075, bottom / height, 0.86, 0.74 * PANEL_HEIGHT / height)
        axes = figure.add_axes(box, sharex=drawn[0] if drawn else None)
        draw_panel(axes, panel)
        axes.tick_params(length=0, labelbottom=i == len(panels) - 1)
        drawn.append(axes)
    drawn[-1].set_xlim(first, last if last > first else first + 1.0)
    drawn[-1].set_xlabel("frame", color=GREY, labelpad=1)
    seconds = drawn[0].secondary_xaxis("top", functions=_seconds(first, fps))
    seconds.spines["top"].set_visible(False)
    seconds.tick_params(length=0, pad=24)
    seconds.xaxis.set_major_formatter("{x:g} s")
    return figure


def _seconds(first: float, fps: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the functions from frames to seconds since the first frame, and back."""
    return lambda frame: (frame - first) / fps, lambda seconds: seconds * fps + first
