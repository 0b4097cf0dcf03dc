"""Panels of pages of figures that only reviews have: histograms and stacked bars over frames."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.pipeline.plugins.review.plot import Curves, as_plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RED, GREY = "#c4553b", "#8a9299"

BAR_INKS = ("#5f7f9c", "#a8643f", "#c9a45c", "#7f9a6e")
"""The colours of the parts of bars, in their order."""


class HeatMap(NamedTuple):
    """Histograms over frames (T,): shares (T, B) in equal bins from 0 to `top`.

    levels  horizontal lines over it, each a value and a word
    line    a curve (T,) over it
    told    further numbers (T,) of the frames by name, which the review page writes beside it
    """

    name: str
    unit: str
    frames: NDArray[np.float64]
    shares: NDArray[np.float64]
    top: float
    levels: tuple[tuple[float, str], ...] = ()
    line: NDArray[np.float64] | None = None
    told: Mapping[str, NDArray[np.float64]] = MappingProxyType({})

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and highest value of the axis."""
        return 0.0, self.top

    @property
    def shapes(self) -> dict[str, Any]:
        """What the review page draws."""
        lines = [] if self.line is None else [as_plain(self.line)]
        told = as_plain(self.told)
        return {"heat": self.shares.tolist(), "levels": self.levels, "curves": lines, "told": told}

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
    """Parts by name (T,), stacked over frames (T,); negative parts hang down.

    top   where the axis ends, and longer bars are cut; None for as long as they are
    told  further numbers (T,) of the frames by name, which the review page writes beside it
    """

    name: str
    unit: str
    frames: NDArray[np.float64]
    parts: dict[str, NDArray[np.float64]]
    top: float | None = None
    told: Mapping[str, NDArray[np.float64]] = MappingProxyType({})

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and highest value of the axis."""
        heights = np.nan_to_num(list(self.parts.values()))
        below, above = np.minimum(heights, 0.0).sum(axis=0), np.maximum(heights, 0.0).sum(axis=0)
        return float(below.min()), self.top or float(above.max()) or 1.0

    @property
    def shapes(self) -> dict[str, Any]:
        """What the review page draws."""
        return {"bars": as_plain(self.parts), "told": as_plain(self.told)}

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
        if self.top:
            axes.set_ylim(top=self.top)
        if below.any():
            axes.axhline(0.0, color=GREY, linewidth=0.7)
            axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")


FigurePanel = Curves | HeatMap | StackedBars


def panel_data(panel: FigurePanel) -> dict[str, Any]:
    """Return a panel as JSON for the charts of the review page (page/measures.js)."""
    about = {"title": panel.name, "unit": panel.unit, "frames": panel.frames.tolist(), "range": panel.range}
    return {**about, "curves": [], "bars": {}, "heat": [], "levels": [], **panel.shapes}
