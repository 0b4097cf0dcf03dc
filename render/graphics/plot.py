"""Write pages of plots over frames with matplotlib, one panel above another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import BadInputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, GREY, FAINT = "#23282d", "#8a9299", "#e4e6e8"
PENS = ("#c4553b", "#5b8a5a", "#2c6e91")
"""The colours of x, y and z; a single number has the last."""

BAR_INKS = ("#5f7f9c", "#a8643f", "#c9a45c", "#7f9a6e")
"""The colours of the parts of bars, in their order."""

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


_KEY_MARK: Any = {"color": "white", "markersize": 4.6, "markeredgewidth": 1.4, "clip_on": False, "zorder": 5}


class Curves(NamedTuple):
    """Numbers over frames (T,): values (T, K), and keys (N, 1 + K) of frames and values. NaN is a gap."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    values: NDArray[np.float64]
    keys: NDArray[np.float64]


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


class StackedBars(NamedTuple):
    """Parts by name (T,), stacked over frames (T,); negative parts hang down."""

    name: str
    unit: str
    frames: NDArray[np.float64]
    parts: dict[str, NDArray[np.float64]]


Panel = Curves | HeatMap | StackedBars


def plot_panels(title: str, panels: Sequence[Panel], fps: float, path: Path) -> None:
    """Write a page of panels over the same frames, as SVG, PNG or PDF; the same bytes every time.

    Raises BadInputError for another ending or no panels, MachineError where the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise BadInputError(
            f"{path}: a page of curves can be {', '.join(ENDINGS)}; end its name with one of these"
        )
    if not panels:
        raise BadInputError("a page of no curves is not possible")
    import matplotlib as mpl

    with mpl.rc_context({**mpl.rcParamsDefault, **STYLE}), atomic_write(path) as temporary:
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
    to_seconds, to_frames = lambda frame: (frame - first) / fps, lambda seconds: seconds * fps + first
    seconds = drawn[0].secondary_xaxis("top", functions=(to_seconds, to_frames))
    seconds.spines["top"].set_visible(False)
    seconds.tick_params(length=0, pad=24)
    seconds.xaxis.set_major_formatter("{x:g} s")
    return figure


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw a panel, with its name and unit above."""
    unit = f"   {panel.unit}" if panel.unit else ""
    axes.text(0.0, 1.04, panel.name, transform=axes.transAxes, size=8.5, va="bottom")
    axes.annotate(unit, (1.0, 1.04), xycoords="axes fraction", size=8, color=GREY, va="bottom", ha="right")
    match panel:
        case Curves():
            _draw_curves(axes, panel)
        case HeatMap():
            _draw_heat_map(axes, panel)
        case StackedBars():
            _draw_bars(axes, panel)
    axes.locator_params(axis="y", nbins=4)


def _draw_curves(axes: Axes, curves: Curves) -> None:
    several = curves.values.shape[1] > 1
    for k, pen in enumerate(PENS if several else PENS[-1:]):
        axes.plot(curves.frames, curves.values[:, k], color=pen, linewidth=1.7, clip_on=False)
        if len(curves.keys):
            axes.plot(curves.keys[:, 0], curves.keys[:, 1 + k], "o", markeredgecolor=pen, **_KEY_MARK)
        if several:
            _label(axes, "xyz"[k], float(curves.values[-1, k]), 7 + 8 * k, color=pen, size=8.5)
    low, high = float(np.nanmin(curves.values)), float(np.nanmax(curves.values))
    room = 0.12 * (high - low) if high > low else max(1.0, abs(high))
    axes.set_ylim(low - room, high + room)


def _label(axes: Axes, text: str, value: float, points: float, **style: Any) -> None:
    """Write a text next to a panel at the height of a value, some points from its right edge."""
    place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    axes.annotate(text, (1.0, value), xytext=(points, 0), va="center", **place, **style)


def _draw_heat_map(axes: Axes, heat: HeatMap) -> None:
    first, last = float(heat.frames[0]), float(heat.frames[-1])
    axes.imshow(
        np.sqrt(heat.shares.T),
        origin="lower",
        aspect="auto",
        extent=(first - 0.5, last + 0.5, 0.0, heat.top),
        cmap="Greys",
        interpolation="nearest",
    )
    axes.grid(visible=False)
    for value, word in heat.levels:
        axes.axhline(value, color=PENS[0], linewidth=0.8, linestyle=(0, (4, 3)))
        _label(axes, word, value, 4, color=PENS[0], size=7.5)
    if heat.line is not None:
        axes.plot(heat.frames, heat.line, color=PENS[0], linewidth=1.4)


def _draw_bars(axes: Axes, bars: StackedBars) -> None:
    above, below = np.zeros(len(bars.frames)), np.zeros(len(bars.frames))
    for index, (name, values) in enumerate(bars.parts.items()):
        heights = np.nan_to_num(values)
        base = np.where(heights >= 0.0, above, below)
        ink = BAR_INKS[index % len(BAR_INKS)]
        axes.bar(bars.frames, heights, bottom=base, width=0.86, color=ink, linewidth=0)
        above, below = above + np.maximum(heights, 0.0), below + np.minimum(heights, 0.0)
        place: Any = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom"}
        axes.annotate(name, (0.0, 1.04), xytext=(150 + 74 * index, 0), size=8, color=ink, **place)
    if below.any():
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
