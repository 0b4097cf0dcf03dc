"""A shot on one page: a contact sheet of its frames, or panels with its measures over the frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.frames import FrameRange
from pipeline.production.picture_sequences import shown_picture
from pipeline.production.request.keys import picture_keys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import STAGES
from pipeline.production.store.store import Store
from render.graphics.contact_sheet import columns_for, fitted_sheet
from render.graphics.plot import Curves, HeatMap, Panel, StackedBars
from render.post.image import write_png

DEFAULT_FRAMES = 12  # most frames of a sheet where none are requested

LONGEST_BAR = 1.6
"""The axis of seconds ends at this multiple of the 90th percentile, for first frames compile kernels."""


def spread(request: RenderRequest) -> RenderRequest:
    """Return a request for at most DEFAULT_FRAMES frames at equal distances."""
    numbers = sorted(request.angles)
    return replace(request, requested=tuple(numbers[:: -(-len(numbers) // DEFAULT_FRAMES)]))


@dataclass(frozen=True)
class ShotSheet:
    """A sheet of the requested frames; by default `columns` give it about the aspect of a screen."""

    request: RenderRequest
    store: Store
    columns: int | None = None

    @property
    def place(self) -> Path:
        """The path of the sheet, relative to the root."""
        request, frames = self.request, FrameRange.of(self.request.requested)
        return request.folders.home / request.quality_name / f"{request.name}.sheet.{frames}.png"

    def write(self, path: Path) -> None:
        """Write the sheet as PNG; missing frames are shown as missing. Raises MachineError."""
        request, numbers = self.request, self.request.requested
        size = request.quality.rendered_size
        columns = min(len(numbers), self.columns or columns_for(len(numbers), size))
        rate = request.shot.rate
        seconds = [rate.seconds(number - request.shot.frames.first) for number in numbers]
        captions = [(("frame", f"{n}   {s:.2f} s"),) for n, s in zip(numbers, seconds, strict=True)]
        sheet, factor = fitted_sheet(request.shot.heading, captions, size, columns)
        keys = picture_keys(request, self.store)
        pictures = [shown_picture(request, keys, self.store, n, factor, 8, "srgb") for n in numbers]
        header = {"shot": request.name, "frames": str(FrameRange.of(numbers))}
        page = sheet.picture(pictures, request.quality_name)
        self.store.write(path, lambda draft: write_png(draft, page, header))


Row = Mapping[str, Any]  # the measures of one frame, by name


def panels(
    numbers: Sequence[int],
    measures: Mapping[int, Row],
    limits: tuple[float | None, float | None],
    seconds: Mapping[str, Mapping[int, float]],
) -> list[Panel]:
    """Return the panels of a shot from measures by frame, and seconds by stage and frame.

    limits  minimum and maximum edge length, if they are numbers
    """
    frames = np.array(numbers, np.float64)
    rows = [measures.get(number, {}) for number in numbers]
    return [*_mesh_panels(frames, rows, limits), *_seconds_panel(frames, numbers, seconds)]


def _mesh_panels(
    frames: Floats, rows: Sequence[Row], limits: tuple[float | None, float | None]
) -> Iterator[Panel]:
    def values(*names: str) -> Floats:
        found = [[row.get(name) for name in names] for row in rows]
        return np.array([[v if isinstance(v, (int, float)) else np.nan for v in row] for row in found], float)

    none = np.zeros((0, 2))
    if _has(vertices := values("vertices")):
        yield Curves("vertices", "", frames, vertices, none)
    if _has(changes := values("splits", "collapses")):
        bars = {"splits": changes[:, 0], "collapses": -changes[:, 1]}
        yield StackedBars("splits and collapses", "a frame", frames, bars)
    if (top := next((row["edge_top"] for row in rows if row.get("edge_top")), None)) is not None:
        levels = tuple((value, word) for value, word in zip(limits, ("min", "max"), strict=True) if value)
        yield HeatMap("edge lengths", "scene units", frames, _shares(rows, "edges"), float(top), levels)
    if any(row.get("quality") for row in rows):
        title, worst = "roundness of triangles; the line: a hundredth is below", values("worst")[:, 0]
        yield HeatMap(title, "1: equilateral", frames, _shares(rows, "quality"), 1.0, line=worst)
    if _has(area := values("area")):
        yield Curves("area", "scene units²", frames, area, none)
    if _has(volume := values("volume")):
        yield Curves("volume", "scene units³", frames, volume, none)
    crossings = values("crossings")
    if np.nansum(crossings) > 0:
        counted = np.isfinite(crossings[:, 0])
        unit = "pairs of faces" if counted.all() else "pairs of faces, counted in the frames with a dot"
        dots = np.column_stack([frames, crossings])[counted]
        keys = none if counted.all() else dots
        yield Curves("crossings", unit, dots[:, 0], dots[:, 1:], keys)


def _seconds_panel(
    frames: Floats, numbers: Sequence[int], seconds: Mapping[str, Mapping[int, float]]
) -> Iterator[Panel]:
    timed = [stage for stage in STAGES if stage in seconds]
    bars = {stage: np.array([seconds[stage].get(n, 0.0) for n in numbers]) for stage in timed}
    if not bars:
        return
    total = np.sum(list(bars.values()), axis=0)
    longest = LONGEST_BAR * float(np.quantile(total, 0.9))
    scale = np.minimum(1.0, longest / np.maximum(total, 1e-9)) if longest else 1.0
    unit = "s (the longest cut short)" if longest and (total > longest).any() else "s"
    scaled = {STAGES[stage].doing: values * scale for stage, values in bars.items()}
    yield StackedBars("seconds a frame", unit, frames, scaled)


def _has(values: Floats) -> bool:
    return bool(np.isfinite(values).any())


def _shares(rows: Sequence[Row], name: str) -> Floats:
    """Return histograms (T, B); zeros for frames without one."""
    bins = next(len(row[name]) for row in rows if row.get(name))
    return np.array([row.get(name) or [0.0] * bins for row in rows], np.float64)
