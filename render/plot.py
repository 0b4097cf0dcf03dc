"""Curves on a page: values over frames, one panel for each. The one room that knows matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.appear import appearing
from render.errors import BadInputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, GREY, FAINT = "#23282d", "#8a9299", "#e4e6e8"
PENS = ("#c4553b", "#5b8a5a", "#2c6e91")
"""Of x, y and z; what is a number alone has the last."""

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


class Track(NamedTuple):
    """name and unit; frames (T,), values (T, K), and keys (N, 1 + K): frames and values."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    values: NDArray[np.float64]
    keys: NDArray[np.float64]


def plot_tracks(title: str, tracks: Sequence[Track], fps: float, path: Path) -> None:
    """Write a page of tracks over the same frames, as its ending says; the same bytes every time.

    Raises BadInputError for another ending or no tracks, RenderEnvironmentError where the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise BadInputError(f"{path}: a page of curves can be {', '.join(ENDINGS)}; end its name so")
    if not tracks:
        raise BadInputError("a page of no curves is not possible")
    import matplotlib as mpl

    with mpl.rc_context(STYLE), appearing(path) as temporary:
        figure = _page(title, tracks, fps)
        kind = path.suffix.lower().lstrip(".")
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        figure.savefig(temporary, format=kind, dpi=110, metadata=metadata)


def _page(title: str, tracks: Sequence[Track], fps: float) -> Figure:
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
        _draw(panel, track)
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


def _draw(panel: Axes, track: Track) -> None:
    unit = f"   {track.unit}" if track.unit else ""
    panel.text(0.0, 1.04, track.name, transform=panel.transAxes, size=8.5, va="bottom")
    panel.annotate(unit, (1.0, 1.04), xycoords="axes fraction", size=8, color=GREY, va="bottom", ha="right")
    several = track.values.shape[1] > 1
    for k, pen in enumerate(PENS if several else PENS[-1:]):
        panel.plot(track.frames, track.values[:, k], color=pen, linewidth=1.7, clip_on=False)
        if len(track.keys):
            panel.plot(
                track.keys[:, 0],
                track.keys[:, 1 + k],
                "o",
                color="white",
                markeredgecolor=pen,
                markersize=4.6,
                markeredgewidth=1.4,
                clip_on=False,
                zorder=5,
            )
        if several:
            panel.annotate(
                "xyz"[k],
                (1.0, float(track.values[-1, k])),
                xycoords=("axes fraction", "data"),
                xytext=(7 + 8 * k, 0),
                textcoords="offset points",
                color=pen,
                va="center",
                size=8.5,
            )
    low, high = float(track.values.min()), float(track.values.max())
    room = 0.12 * (high - low) if high > low else max(1.0, abs(high))
    panel.set_ylim(low - room, high + room)
    panel.locator_params(axis="y", nbins=4)
