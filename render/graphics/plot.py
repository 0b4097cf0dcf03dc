"""Curves on a page: values over frames, one panel for each. The one room that knows matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from render.base.atomic_write import atomic_write
from render.base.errors import BadInputError
from render.graphics.panels import FAINT, GREY, INK, Panel, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".png", ".pdf")

WIDE, PANEL, HEAD, FOOT = 9.6, 1.25, 0.7, 0.5
"""Inches: the page, a panel with its name, the title and what is below the panels."""

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
"""One type and one set of lines, for pages of curves and for the figures of the docs."""


def plot_tracks(title: str, tracks: Sequence[Panel], fps: float, path: Path) -> None:
    """Write a page of tracks over the same frames, as its ending says; the same bytes every time.

    Raises BadInputError for another ending or no tracks, MachineError where the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise BadInputError(f"{path}: a page of curves can be {', '.join(ENDINGS)}; end its name so")
    if not tracks:
        raise BadInputError("a page of no curves is not possible")
    import matplotlib as mpl

    with mpl.rc_context(STYLE), atomic_write(path) as temporary:
        figure = _page(title, tracks, fps)
        kind = path.suffix.lower().lstrip(".")
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        figure.savefig(temporary, format=kind, dpi=110, metadata=metadata)


def _page(title: str, tracks: Sequence[Panel], fps: float) -> Figure:
    from matplotlib.figure import Figure

    height = HEAD + FOOT + PANEL * len(tracks)
    figure = Figure(figsize=(WIDE, height), facecolor="white")
    figure.text(0.075, 1.0 - 0.3 / height, title, size=12, weight="bold", va="center")
    first, last = float(tracks[0].frames[0]), float(tracks[0].frames[-1])
    panels: list[Axes] = []
    for i, track in enumerate(tracks):
        bottom = FOOT + PANEL * (len(tracks) - 1 - i)
        box = (0.075, bottom / height, 0.86, 0.74 * PANEL / height)
        panel = figure.add_axes(box, sharex=panels[0] if panels else None)
        draw(panel, track)
        panel.tick_params(length=0, labelbottom=i == len(tracks) - 1)
        panels.append(panel)
    panels[-1].set_xlim(first, last if last > first else first + 1.0)
    panels[-1].set_xlabel("frame", color=GREY, labelpad=1)
    clock = panels[0].secondary_xaxis("top", functions=_seconds(first, fps))
    clock.spines["top"].set_visible(False)
    clock.tick_params(length=0, pad=24)
    clock.xaxis.set_major_formatter("{x:g} s")
    return figure


def _seconds(first: float, fps: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """From frames to seconds from the first, and back."""
    return lambda frame: (frame - first) / fps, lambda seconds: seconds * fps + first
