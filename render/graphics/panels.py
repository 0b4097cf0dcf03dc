"""Panels of a page of curves: what each shows over the frames, and how it is drawn on matplotlib's axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, GREY, FAINT = "#23282d", "#8a9299", "#e4e6e8"
PENS = ("#c4553b", "#5b8a5a", "#2c6e91")
"""Of x, y and z; what is a number alone has the last."""

BAR_INKS = ("#5f7f9c", "#a8643f", "#c9a45c", "#7f9a6e")
"""Of the parts of bars, in their order."""


class Track(NamedTuple):
    """name and unit; frames (T,), values (T, K), and keys (N, 1 + K): frames and values. NaN is a gap."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    values: NDArray[np.float64]
    keys: NDArray[np.float64]


class Heat(NamedTuple):
    """name and unit; frames (T,), shares (T, B) in equal bins from 0 to `top`, and what is drawn over them:
    levels, each with a word, and a line (T,), if any."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    shares: NDArray[np.float64]
    top: float
    levels: tuple[tuple[float, str], ...] = ()
    line: NDArray[np.float64] | None = None


class Bars(NamedTuple):
    """name and unit; frames (T,), and parts by name (T,), one upon another; negative ones hang down."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    parts: dict[str, NDArray[np.float64]]


Panel = Track | Heat | Bars


def draw(panel: Axes, track: Panel) -> None:
    """With its name and unit above."""
    unit = f"   {track.unit}" if track.unit else ""
    panel.text(0.0, 1.04, track.name, transform=panel.transAxes, size=8.5, va="bottom")
    panel.annotate(unit, (1.0, 1.04), xycoords="axes fraction", size=8, color=GREY, va="bottom", ha="right")
    match track:
        case Track():
            _draw_curves(panel, track)
        case Heat():
            _draw_heat(panel, track)
        case Bars():
            _draw_bars(panel, track)
    panel.locator_params(axis="y", nbins=4)


def _draw_curves(panel: Axes, track: Track) -> None:
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
    low, high = float(np.nanmin(track.values)), float(np.nanmax(track.values))
    room = 0.12 * (high - low) if high > low else max(1.0, abs(high))
    panel.set_ylim(low - room, high + room)


def _draw_heat(panel: Axes, track: Heat) -> None:
    first, last = float(track.frames[0]), float(track.frames[-1])
    panel.imshow(
        np.sqrt(track.shares.T),
        origin="lower",
        aspect="auto",
        extent=(first - 0.5, last + 0.5, 0.0, track.top),
        cmap="Greys",
        interpolation="nearest",
    )
    panel.grid(visible=False)
    for value, word in track.levels:
        panel.axhline(value, color=PENS[0], linewidth=0.8, linestyle=(0, (4, 3)))
        panel.annotate(
            word,
            (1.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            size=7.5,
            color=PENS[0],
            va="center",
        )
    if track.line is not None:
        panel.plot(track.frames, track.line, color=PENS[0], linewidth=1.4)


def _draw_bars(panel: Axes, track: Bars) -> None:
    above, below = np.zeros(len(track.frames)), np.zeros(len(track.frames))
    for index, (name, values) in enumerate(track.parts.items()):
        heights = np.nan_to_num(values)
        base = np.where(heights >= 0.0, above, below)
        ink = BAR_INKS[index % len(BAR_INKS)]
        panel.bar(track.frames, heights, bottom=base, width=0.86, color=ink, linewidth=0)
        above, below = above + np.maximum(heights, 0.0), below + np.minimum(heights, 0.0)
        panel.annotate(
            name,
            (0.0, 1.04),
            xycoords="axes fraction",
            xytext=(150 + 74 * index, 0),
            textcoords="offset points",
            size=8,
            color=ink,
            va="bottom",
        )
    if below.any():
        panel.axhline(0.0, color=GREY, linewidth=0.7)
        panel.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
