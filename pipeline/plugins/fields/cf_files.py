"""Velocities of files that follow the CF conventions, time by time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields import stored_arrays
from flowsculpt.pipeline.plugins.fields.cf_conventions import (
    EAST,
    NORTH,
    TIME,
    UP,
    ConventionError,
    attribute_number,
    speed_factor,
    text,
)
from flowsculpt.pipeline.plugins.fields.cf_headers import (
    FILLED,
    FileHeader,
    Selection,
    convention_faults,
    read_header,
)
from flowsculpt.pipeline.plugins.fields.curvilinear_grids import CurvilinearGrid
from flowsculpt.pipeline.plugins.fields.grid_layout import Box, Coordinates, GridLayout, Placing, mirrored
from flowsculpt.pipeline.plugins.fields.stored_arrays import ChunkGrid
from flowsculpt.pipeline.plugins.fields.windowed_samples import (
    SourceFiles,
    WindowedSamples,
    file_digest,
)

EVEN_VERSION = 1
"""Raised when equal curvilinear grids give other velocities."""

DAY = 86400.0
YEARS = {
    "standard": (365.2425 * DAY, 365.0 * DAY, 366.0 * DAY),
    "360_day": (360.0 * DAY,),
    "noleap": (365.0 * DAY,),
    "365_day": (365.0 * DAY,),
    "all_leap": (366.0 * DAY,),
    "366_day": (366.0 * DAY,),
}
"""Lengths that a year of data may have, by calendar, seconds."""

PLACES = EAST, NORTH, UP
ALL = slice(None)

LAYER_PARTS = 8  # parts in which the layers of a file without chunks are read


@dataclass(frozen=True)
class CFSamples(WindowedSamples):
    """Velocities of files with the same grid, one after another in time."""

    paths: tuple[tuple[Path, ...], ...]
    selection: Selection
    placing: Placing
    headers: tuple[FileHeader, ...] = field(compare=False, repr=False)

    is_paced = True

    @cached_property
    def layout(self) -> GridLayout:
        return GridLayout(self.headers[0].coordinates, self.placing)

    @property
    def axes(self) -> tuple[Floats, Floats, Floats]:  # type: ignore[override]
        return self.layout.axes

    @property
    def geometry(self) -> int:  # type: ignore[override]
        return self.layout.geometry

    @property
    def spacing(self) -> float:
        return self.layout.spacing

    def metric(self, axis: int) -> Floats:
        return self.layout.metric(axis)

    @cached_property
    def times(self) -> Floats:  # type: ignore[override]
        """Seconds after the first time."""
        times = self._seconds
        return times - times[0]

    def date(self, seconds: float) -> str:
        """Return the date and time at seconds after the first time; empty where the files have none."""
        units = self.headers[0].time_units
        return "" if units is None else units.date((seconds + float(self._seconds[0])) / units.seconds)

    @cached_property
    def period(self) -> float:
        """Seconds after which the first time comes again: a day or a year where the times fill one.

        They do where the step from the last time to the next first one is like the others: twelve months, or
        24 hours. Raises UsageError for means over years that fill none: nothing says when they repeat.
        """
        units, times = self.headers[0].time_units, self.times
        whole, steps = float(times[-1] - times[0]), np.diff(times)
        for length in (DAY, *YEARS.get(units.calendar if units else "", YEARS["standard"])):
            if len(steps) > 1 and 0.97 * steps.min() <= length - whole <= 1.03 * steps.max():
                return length
        if units is not None and units.is_climatology and abs(whole / YEARS["standard"][0] - 1.0) > 0.02:
            raise UsageError(
                f"{self.headers[0].path}: its {plural(len(times), 'time')} are means over years and do not "
                "fill one evenly, so loop cannot join them. Leave loop out."
            )
        return whole

    def seconds_until(self, other: CFSamples) -> float:
        """Return the seconds from the first time to that of others; 0 where one of them has no date."""
        one, two = self.headers[0].time_units, other.headers[0].time_units
        if one is None or two is None:
            return 0.0
        return one.seconds_between(two) + float(other._seconds[0] - self._seconds[0])

    @property
    def metre(self) -> float:  # type: ignore[override]
        return self.layout.unit

    @property
    def surface(self) -> tuple[str, int] | None:  # type: ignore[override]
        first = self.headers[0]
        heights = first.coordinates.up
        if heights is None or not first.coordinates.is_geographic or heights[-1] > 0.0:
            return None
        return first.axes[UP].dimension, 0 if UP in first.turned else len(heights) - 1

    @cached_property
    def _seconds(self) -> Floats:
        """Seconds after the date at 0 of the first file."""
        first, parts = self.headers[0], []
        for k, header in enumerate(self.headers):
            if header.time_units is None or first.time_units is None:
                parts.append(np.array([self.selection.interval * k]))
                continue
            since = first.time_units.seconds_between(header.time_units)
            parts.append(since + header.time_units.seconds * header.times)
        return np.concatenate(parts)

    def seconds_of(self, date: str) -> float:
        """Return the seconds from the first time to a date. Raises UsageError for one that the data lack."""
        first, last = self.headers[0], self.headers[-1]
        with convention_faults(first.path):
            units = first.time_units
            if units is None:
                raise ConventionError("it has no times; leave out start")
            seconds = units.seconds * (units.number_of(date) - float(first.times[0]))
            if not -1e-6 <= seconds <= self.times[-1] + 1e-6:
                ends = units.date(float(first.times[0])), last.time_units.date(float(last.times[-1]))  # type: ignore[union-attr]
                raise ConventionError(f"start is {date}, and its times are {ends[0]} to {ends[1]}")
        return min(max(seconds, 0.0), float(self.times[-1]))

    @cached_property
    def _where(self) -> list[tuple[int, int]]:
        """The file of each time, and its index in there."""
        return [(k, i) for k, header in enumerate(self.headers) for i in range(max(1, len(header.times)))]

    @property
    def settings(self) -> Any:
        chosen, placing = self.selection, self.placing
        names = sorted(self.headers[0].names.items())
        placed = [placing.map, placing.up, placing.fit, placing.exaggerate, placing.land]
        grid = self.headers[0].curvilinear
        even = [] if grid is None else [["even", EVEN_VERSION, *grid.grid.shape, grid.along]]
        here = self.headers[0].coordinates
        level = ["level"] if here.is_height and here.up is None else []
        return ["cf", names, list(chosen.at), chosen.group, placed, *even, *level]

    def place(self, index: int) -> Any:
        k, i = self._where[index]
        header = self.headers[k]
        if TIME not in header.axes:
            return 0
        name = header.names[next(iter(header.names))]
        dimension = self._dimensions[name].index(header.axes[TIME].dimension)
        return stored_arrays.position_in_chunk(header.path, self.selection.group, name, dimension, i)

    @cached_property
    def _dimensions(self) -> dict[str, tuple[str, ...]]:
        header = self.headers[0]
        with stored_arrays.opened_together(header.paths, self.selection.group) as dataset:
            return {name: tuple(map(str, dataset.variables[name].dims)) for name in header.names.values()}

    def current_files(self, index: int, has_velocities: bool = True) -> SourceFiles:
        k, i = self._where[index]
        header, at = self.headers[k], dict(self.selection.at)
        if TIME in header.axes:
            at[header.axes[TIME].dimension] = i
        if not header.path.is_dir():
            return tuple((path, file_digest(path)) for path in header.paths)
        fixed: dict[str, dict[int, int]] = {axis.coordinate: {} for axis in header.axes.values()}
        for name, dimensions in self._dimensions.items():
            fixed[name] = {n: at[dimension] for n, dimension in enumerate(dimensions) if dimension in at}
        lacking = () if has_velocities else tuple(self._dimensions)
        return stored_arrays.stored_files(header.path, self.selection.group, fixed, lacking)

    @cached_property
    def parts(self) -> tuple[list[slice], ...] | None:  # type: ignore[override]
        """The chunks of Zarr stores, where each node has the velocity of one of the data."""
        first, is_sliding = self.headers[0], self.placing.land == "slide"
        if first.curvilinear is not None or not self.layout.is_plain or is_sliding or not self._chunk_grids:
            return None
        found = []
        for axis in PLACES:
            if axis not in first.axes:
                found.append([slice(0, 2)])
                continue
            count, dimension = len(first.axes[axis].values), first.axes[axis].dimension
            grids = [each for grids in self._chunk_grids for each in grids.items()]
            size, *others = {grid.sizes[self._dimensions[name].index(dimension)] for name, grid in grids}
            if others:
                return None
            parts = [slice(k, min(k + size, count)) for k in range(0, count, size)]
            is_turned = axis in first.turned
            found.append([mirrored(part, count) for part in reversed(parts)] if is_turned else parts)
        return self.layout.in_scene(found)

    @cached_property
    def _chunk_grids(self) -> list[dict[str, ChunkGrid]]:
        """The chunks of each Zarr store by variable; none if a file is none."""
        if not all(header.path.is_dir() for header in self.headers):
            return []
        homes = [header.path / (self.selection.group or "") for header in self.headers]
        return [{name: ChunkGrid.of(home / name) for name in self._dimensions} for home in homes]

    @cached_property
    def _datasets(self) -> dict[int, Any]:
        """The Zarr stores whose chunks were read."""
        return {}

    def read_chunk(self, index: int, out: np.ndarray, box: Box) -> SourceFiles:
        k, i = self._where[index]
        header, grids, place = self.headers[k], self._chunk_grids[k], self.layout.in_data(box)
        east, north, up = (
            mirrored(part, len(header.axes[axis].values)) if axis in header.turned else part
            for axis, part in zip(PLACES, place, strict=True)
        )
        with stored_arrays.reported(header.path), convention_faults(header.path):
            if k not in self._datasets:
                self._datasets[k] = stored_arrays.open_dataset(header.path, self.selection.group)
            stored = east, north, up
            components, missing = self._components(header, self._datasets[k], i, stored, grids)
            self.layout.fill(out, place, components, missing, header.is_angular)
        at = [self._indices(header, dims, i, stored) for dims in self._dimensions.values()]
        files = [grid.file(list(each.values())) for grid, each in zip(grids.values(), at, strict=True)]
        return tuple((path, file_digest(path) if path.is_file() else "") for path in files)

    def read(self, index: int) -> np.ndarray:
        k, i = self._where[index]
        header, out = self.headers[k], self.layout.empty()
        with (
            stored_arrays.opened_together(header.paths, self.selection.group) as dataset,
            convention_faults(header.path),
        ):
            for stored, layers in self._layers(header, dataset):
                components, missing = self._components(header, dataset, i, stored)
                if header.curvilinear is not None:
                    components, missing = header.curvilinear.resampled(components, missing)
                self.layout.fill(out, (ALL, ALL, layers), components, missing, header.is_angular)
                del components, missing  # before others take as much memory
        return out

    def resampling_error(self) -> float:
        """Return the rms error of the first time at the nodes of a curvilinear grid, over its rms."""
        header = self.headers[0]
        assert header.curvilinear is not None, "other grids are read as they are"
        with (
            stored_arrays.opened_together(header.paths, self.selection.group) as dataset,
            convention_faults(header.path),
        ):
            level = replace(header, names={axis: name for axis, name in header.names.items() if axis != UP})
            components, missing = self._components(level, dataset, 0, (ALL, ALL, slice(0, 1)))
        return header.curvilinear.error(components, missing)

    def _components(
        self,
        header: FileHeader,
        dataset: Any,
        index: int,
        box: Box,
        grids: Mapping[str, ChunkGrid] | None = None,
    ) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
        """Return the components as of `_component`, 0 where any is missing, and where that is."""
        components, missing = {}, None
        for axis, name in header.names.items():
            grid = None if grids is None else grids[name]
            components[axis], lacking = self._component(header, dataset.variables[name], index, box, grid)
            if lacking is not None:
                missing = lacking if missing is None else missing | lacking
        if missing is not None:
            for values in components.values():
                values[missing] = 0.0
        return components, missing

    def _layers(self, header: FileHeader, dataset: Any) -> Iterator[tuple[Box, slice]]:
        """Yield what to read at once: indices in the file, and layers of the grid along the axis up.

        Reading all at once would take as much memory again.
        """
        if UP not in header.axes or self.placing.land == "slide":
            yield (ALL, ALL, ALL), ALL
            return
        count, dimension = len(header.axes[UP].values), header.axes[UP].dimension
        variable = dataset.variables[next(iter(header.names.values()))]
        chunk = variable.encoding.get("preferred_chunks", {}).get(dimension)
        step = chunk or -(-count // LAYER_PARTS)
        for first in range(0, count, step):
            last = min(first + step, count)
            part = slice(first, last)
            yield (ALL, ALL, part), mirrored(part, count) if UP in header.turned else part

    def _indices(
        self, header: FileHeader, dims: tuple[str, ...], index: int, box: Box
    ) -> dict[str, int | slice]:
        """Return what of each dimension of a variable is read."""
        at: dict[str, Any] = dict.fromkeys(dims, 0) | dict(self.selection.at)
        if TIME in header.axes:
            at[header.axes[TIME].dimension] = index
        at |= {header.axes[axis].dimension: box[k] for k, axis in enumerate(PLACES) if axis in header.axes}
        return {name: at[name] for name in dims}

    def _component(
        self,
        header: FileHeader,
        variable: Any,
        index: int,
        box: Box,
        grid: ChunkGrid | None = None,
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return a component as float32 (E, N, U) in m/s or radians per second, and where it is missing."""
        at = self._indices(header, variable.dims, index, box)
        raw = None if grid is None else grid.values(list(at.values()))
        if raw is None:
            raw = np.asarray(variable.isel(at).values)
        dims = [name for name, part in at.items() if isinstance(part, slice)]
        order = [header.axes[axis].dimension for axis in PLACES if axis in header.axes]
        raw = raw.transpose([dims.index(dimension) for dimension in order])
        for k, axis in enumerate(PLACES):
            if axis not in header.axes:
                raw = np.expand_dims(raw, k)
            elif axis in header.turned:
                raw = np.flip(raw, k)
        return decoded(raw, variable.attrs, self.selection.is_number)


def decoded(
    raw: np.ndarray, attributes: Mapping[str, Any], is_number: bool = False
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return what packed numbers stand for, float32 in m/s or radians per second, and where they are missing.

    is_number  True leaves them in their own unit

    §2.5.1, §8.1. Raises ConventionError where attributes are not numbers.
    """
    if raw.dtype.kind == "i" and text(attributes, "_Unsigned").lower() == "true":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    missing = missing_among(raw, attributes)
    scale, offset = (
        attribute_number(attributes, name, "a variable") for name in ("scale_factor", "add_offset")
    )
    units = text(attributes, "units") or "m s-1"
    factor = 1.0 if is_number or units == "1" else speed_factor(units)[0]
    with np.errstate(all="ignore"):
        values = raw.astype(np.float32, copy=not raw.flags.writeable)
        if (whole := factor * (1.0 if scale is None else scale)) != 1.0:
            values *= np.float32(whole)
        if offset:
            values += np.float32(factor * offset)
    return values, missing


def _valid_ends(raw: np.ndarray, attributes: Mapping[str, Any]) -> tuple[float, float]:
    """Return the least and the largest packed number that is not missing; infinite where none is given.

    Ends that are floats, of packed integers, are those of unpacked numbers (NetCDF Users Guide, appendix A).
    Raises ConventionError for ends that are not numbers.
    """
    single = [attributes.get("valid_min", -math.inf), attributes.get("valid_max", math.inf)]
    given = list(np.atleast_1d(attributes["valid_range"])) if "valid_range" in attributes else single
    ends = [np.asarray(end).reshape(-1) for end in given]
    try:
        low, high = (float(end[0]) for end in ends)
    except (TypeError, ValueError, IndexError):
        raise ConventionError(
            "a variable has a valid_min, valid_max or valid_range without numbers"
        ) from None
    if raw.dtype.kind in "iu" and any(end.dtype.kind == "f" and np.isfinite(end[0]) for end in ends):
        scale = attribute_number(attributes, "scale_factor", "a variable") or 1.0
        offset = attribute_number(attributes, "add_offset", "a variable") or 0.0
        low, high = sorted([(low - offset) / scale, (high - offset) / scale])
    return low, high


def missing_among(raw: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray | None:
    """Return where packed numbers are missing, bool; None where all are there."""
    fills = []
    for name in ("_FillValue", "missing_value"):
        for value in np.asarray(attributes.get(name, ())).reshape(-1):
            if isinstance(value, str | bytes | np.str_ | np.bytes_):
                raise ConventionError(f"attribute {name} is {value!r}; it must be a number")
            if value != 0:  # the default of Zarr, where it is a velocity as any other
                with np.errstate(over="ignore"):  # doubles are of the same decimals as floats of the data
                    fills.append(raw.dtype.type(value) if raw.dtype.kind == "f" else value)
    low, high = _valid_ends(raw, attributes)

    def missing_in(values: np.ndarray) -> np.ndarray:
        missing = ~(np.abs(values) < FILLED) if values.dtype.kind == "f" else np.zeros(values.shape, bool)
        for value in fills:
            missing |= values == value
        if low > -math.inf:
            missing |= values < low
        if high < math.inf:
            missing |= values > high
        return missing

    if not raw.size:
        return None
    with np.errstate(all="ignore"):
        ends = np.array([raw.min(), raw.max()])  # NaN where one is there
        is_outside = all(not ends[0] <= value <= ends[1] for value in fills)
        if is_outside and not missing_in(ends).any():
            return None
        missing = missing_in(raw)
    return missing if missing.any() else None


def cf_samples(
    paths: tuple[Path, ...],
    selection: Selection,
    placing: Placing,
    *others: tuple[Path, ...],
    kind: type[CFSamples] = CFSamples,
) -> tuple[CFSamples, tuple[str, ...]]:
    """Return the samples of files with the same grid, one after another in time; and notes on them.

    others  for each of the files one with further components

    Raises UsageError where one cannot be read or its grid is another, MachineError without the packages.
    """
    together = tuple(zip(paths, *others, strict=True))
    if others and any(path.is_dir() for each in together for path in each):
        raise UsageError(f"{paths[0]}: also is for files; a Zarr store has all components. Remove also.")
    headers = tuple(read_header(each, selection) for each in together)
    first = headers[0]
    for header in headers[1:]:
        if header.names != first.names or not _same_grid(header.coordinates, first.coordinates):
            fact = f"its grid or its variables differ from those of {first.path.name}"
            raise UsageError(f"{header.path}: {fact}; all files of a sequence share one grid")
    samples = kind(together, selection, placing, headers)
    with convention_faults(first.path):
        layout, times = samples.layout, samples.times
    if not (np.diff(times) > 0).all():
        k = int(np.argmin(np.diff(times) > 0))
        last, following = (headers[samples._where[n][0]].path for n in (k, k + 1))
        raise UsageError(
            f"{following}: its first time is not after the last one of {last.name}; name files so that their "
            "numbers ascend in time, and leave out those that overlap"
        )
    notes = [f"{first.path.name}: {note}" for note in first.notes]
    if not placing.map and placing.fit is None and first.coordinates.is_geographic:
        size = max(map(float, map(np.ptp, layout.plane)))
        notes.append(
            f"{first.path.name}: the plane is {size / 1000:.4g} km wide, a metre a unit; write fit: 4"
        )
    if first.curvilinear is not None and not selection.is_number:
        notes.append(f"{first.path.name}: {_resampling(samples, first.curvilinear)}")
    return samples, tuple(notes)


def _resampling(samples: CFSamples, grid: CurvilinearGrid) -> str:
    """Return a note on how a curvilinear grid is read; the error is kept in the user's cache."""
    answer = CachedAnswer.of("field_errors", [samples.digest(0)])
    error = answer.load(lambda kept: float(kept["error"]))
    if error is None:
        error = samples.resampling_error()
        answer.store_alone({"error": error})
    before, after = (" × ".join(map(str, each)) for each in (grid.longitudes.shape, grid.grid.shape))
    return (
        f"its curvilinear grid of {before} nodes is read on an even one of {after}; velocities at its own "
        f"nodes differ by {100.0 * error:.2g}% (rms), which a higher resolution makes less"
    )


def _same_grid(one: Coordinates, other: Coordinates) -> bool:
    for first, second in zip((one.east, one.north, one.up), (other.east, other.north, other.up), strict=True):
        if (first is None) != (second is None):
            return False
        if (
            first is not None
            and second is not None
            and not (len(first) == len(second) and np.allclose(first, second, rtol=1e-6, atol=1e-9))
        ):
            return False
    return True
