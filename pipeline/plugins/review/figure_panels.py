"""Panels of pages of figures that only reviews have: histograms and stacked bars over frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RED, GREY = "#c4553b", "#8a9299"

BAR_INKS = ("#5f7f9c", "#a8643f", "#c9a45c", "#7f9a6e")
"""The colours of the parts of bars, in their order."""


class HeatMap(NamedTuple):
    """Histograms over frames (T,): shares (T, B) in equal bins from 0 to `top`.

    levels  horizontal lines over it, each a value and a word
    line    a curve (T,) over it
    """

    name: str
    unit: str
    frames: NDArray[np.float64]
    shares: NDArray[np.float64]
    top: float
    levels: tuple[tuple[float, str], ...] = ()
    line: NDArray[np.float64] | None = None

    def draw(self, axes: Axes) -> None:
        """Draw the shares as greys, and the levels and the line over them."""
        first, last = float(self.frames[0]), float(self.frames[-1])
        axes.imshow(
            np.sqrt(self.shares.T),
            origin="lower",
            aspect="auto",
            extent=(first - 0.5, last + 0.5, 0.0, self.top),
            cmap="Greys",
            interpolation="nearest",
        )
        axes.grid(visible=False)
        for value, word in self.levels:
            axes.axhline(value, color=RED, linewidth=0.8, linestyle=(0, (4, 3)))
            place: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
            axes.annotate(word, (1.0, value), xytext=(4, 0), va="center", color=RED, size=7.5, **place)
        if self.line is not None:
            axes.plot(self.frames, self.line, color=RED, linewidth=1.4)


class StackedBars(NamedTuple):
    """Parts by name (T,), stacked over frames (T,); negative parts hang down."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    parts: dict[str, NDArray[np.float64]]

    def draw(self, axes: Axes) -> None:
        """Draw the bars, and their names above the panel."""
        above, below = np.zeros(len(self.frames)), np.zeros(len(self.frames))
        for index, (name, values) in enumerate(self.parts.items()):
            heights = np.nan_to_num(values)
            base = np.where(heights >= 0.0, above, below)
            ink = BAR_INKS[index % len(BAR_INKS)]
            axes.bar(self.frames, heights, bottom=base, width=0.86, color=ink, linewidth=0)
            above, below = above + np.maximum(heights, 0.0), below + np.minimum(heights, 0.0)
            place: Any = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom"}
            axes.annotate(name, (0.0, 1.04), xytext=(150 + 74 * index, 0), size=8, color=ink, **place)
        if below.any():
            axes.axhline(0.0, color=GREY, linewidth=0.7)
            axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
