"""Write pages of plots over frames with matplotlib, one panel above another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flowsculpt import UsageError
from flowsculpt.api.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, GREY, FAINT = "#23282d", "#8a9299", "#e4e6e8"
PENS = ("#c4553b", "#5b8a5a", "#2c6e91")
"""The colours of x, y and z; a single number has the last."""

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


_BESIDE: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}


class Curves(NamedTuple):
    """Numbers over frames (T,): values (T, K), and keys (N, 1 + K) of frames and values. NaN is a gap.

    told  further numbers (T,) of the frames by name, which the review page writes beside the curves
    """

    name: str
    unit: str
    frames: NDArray[np.float64]
    values: NDArray[np.float64]
    keys: NDArray[np.float64]
    told: Mapping[str, NDArray[np.float64]] = MappingProxyType({})

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and highest value of the axis."""
        low, high = float(np.nanmin(self.values)), float(np.nanmax(self.values))
        room = 0.12 * (high - low) if high > low else max(1.0, abs(high))
        return low - room, high + room

    @property
    def shapes(self) -> dict[str, Any]:
        """What the review page draws."""
        return {"curves": [as_plain(column) for column in self.values.T], "told": as_plain(self.told)}

    def draw(self, axes: Axes) -> None:
        """Draw the curves, with dots at their keys; three of them have names."""
        several = self.values.shape[1] > 1
        for k, pen in enumerate(PENS if several else PENS[-1:]):
            axes.plot(self.frames, self.values[:, k], color=pen, linewidth=1.7, clip_on=False)
            if len(self.keys):
                axes.plot(self.keys[:, 0], self.keys[:, 1 + k], "o", markeredgecolor=pen, **_KEY_MARK)
            if several:
                at, offset = (1.0, float(self.values[-1, k])), (7 + 8 * k, 0)
                axes.annotate("xyz"[k], at, xytext=offset, color=pen, size=8.5, va="center", **_BESIDE)
        axes.set_ylim(self.range)


def as_plain(values: Any) -> Any:
    """Return numbers, or lists or mappings of them, as JSON has them: in nine digits, None for NaN."""
    if isinstance(values, Mapping):
        return {name: as_plain(each) for name, each in values.items()}
    if isinstance(values, np.ndarray):
        return [as_plain(each) for each in values.tolist()]
    return None if np.isnan(values) else float(f"{values:.9g}")


class Panel(Protocol):
    """What a page shows in a row: a name, a unit, the frames (T,), and how it is drawn."""

    @property
    def name(self) -> str: ...

    @property
    def unit(self) -> str: ...

    @property
    def frames(self) -> NDArray[np.float64]: ...

    def draw(self, axes: Axes) -> None:
        """Draw it into axes of matplotlib, which have the frames across."""
        ...


def plot_panels(title: str, panels: Sequence[Panel], fps: float, path: Path) -> None:
    """Write a page of panels over the same frames, as SVG, PNG or PDF; the same bytes every time.

    Raises UsageError for another ending or no panels, MachineError where the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(
            f"{path}: a page of curves can be {', '.join(ENDINGS)}; end its name with one of these"
        )
    if not panels:
        raise UsageError("a page of no curves is not possible")
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
    panel.draw(axes)
    axes.locator_params(axis="y", nbins=4)
