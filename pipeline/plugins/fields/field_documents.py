"""Entries of flows in a shot file: `sampled`, `attraction` and `wind`."""

from dataclasses import fields, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from flowsculpt import MissingInputError, UsageError, read_mesh
from flowsculpt.api.flows import ParameterDoc, Sampled, Samples
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import Clock, Document, FlowParameters, OneOfSeveral, ParseContext, Positive, Triple
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target, Wind
from flowsculpt.pipeline.plugins.fields.cf_conventions import DATE, duration
from flowsculpt.pipeline.plugins.fields.cf_files import CFSamples, cf_samples
from flowsculpt.pipeline.plugins.fields.cf_headers import Selection
from flowsculpt.pipeline.plugins.fields.cf_numbers import CFNumbers
from flowsculpt.pipeline.plugins.fields.chunked_times import SampledByChunk
from flowsculpt.pipeline.plugins.fields.file_sequences import files_named, is_there
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples
from flowsculpt.pipeline.plugins.fields.grid_layout import Placing
from flowsculpt.pipeline.plugins.fields.stored_arrays import is_stored
from flowsculpt.pipeline.plugins.fields.windowed_samples import WindowedSamples

SLOW = 60.0  # seconds between samples from which on a shot in real time is a mistake


def _in_seconds(value: Any) -> Any:
    """Return a length of time such as `1 day` in seconds."""
    return duration(value) if isinstance(value, str) else value


def _as_written(value: Any) -> Any:
    """Return a date as ISO 8601 writes it; YAML makes dates of some texts."""
    written = value.isoformat() if isinstance(value, date) else value
    if isinstance(written, str) and not DATE.fullmatch(written):
        raise ValueError(f"{written!r} is not a date; write a number of seconds, or such as 2019-03-01T06:00")
    return written


class VelocityVariables(Document):
    """The variables of the components of a velocity; one that is left out is 0."""

    x: str | None = Field(None, description="along x, or eastward")
    y: str | None = Field(None, description="along y, or northward")
    z: str | None = Field(None, description="along z, or upward")


_OF_STORED = ("also", "variables", "at", "group", "map", "up", "fit", "exaggerate", "land", "along")
"""Settings of fields in NetCDF, HDF5 and Zarr alone."""


class SampledDocument(FlowParameters):
    """Samples from files, whose axes are read with the shot, so that their mistakes are reported with it."""

    flow = Sampled

    file: Annotated[str, ParameterDoc("where the samples are; with a * a sequence of files")]
    also: Annotated[
        list[str] | None, ParameterDoc("files with the other components, where `file` has one of them")
    ] = None
    array: Annotated[
        str | None, ParameterDoc("the name of the velocities in a VTK file that holds several")
    ] = None
    interval: Annotated[Positive, ParameterDoc("from file to file", "s")] = 1.0
    time_scale: Annotated[
        float,
        BeforeValidator(_in_seconds),
        WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
        Field(ge=-1e12, le=1e12, description="seconds of the samples per second of the shot, or as 1 day"),
    ] = 1.0
    variables: Annotated[
        VelocityVariables | None,
        ParameterDoc("the components, as {x: uo, y: vo}; by default found by standard_name"),
    ] = None
    at: Annotated[
        dict[str, Annotated[int, Field(ge=0)]] | None,
        ParameterDoc("the one of a dimension to read, counted from 0, as {number: 0}"),
    ] = None
    group: Annotated[str | None, ParameterDoc("the group of a NetCDF 4 file or a Zarr store")] = None
    map: Annotated[
        Literal["plane", "sphere"] | None, ParameterDoc("what longitudes and latitudes lie on; else a plane")
    ] = None
    up: Annotated[
        Literal["y", "z"] | None,
        ParameterDoc("the axis of the data that points up; by default z where they have heights, else y"),
    ] = None
    fit: Annotated[
        Positive | None,
        ParameterDoc("longer horizontal side, or diameter of the sphere; else in metres, or 2", "units"),
    ] = None
    exaggerate: Annotated[Positive, ParameterDoc("factor on heights and vertical velocities")] = 1.0
    land: Annotated[
        Literal["stop", "slide"], ParameterDoc("where velocities are missing: 0, or along the coast")
    ] = "stop"
    along: Annotated[
        Literal["east", "grid"] | None,
        ParameterDoc("what components on a curvilinear grid go along; else as their standard names say"),
    ] = None
    resolution: Annotated[
        Annotated[int, Field(ge=2, le=65536)] | None,
        ParameterDoc("nodes along the longest side of the even grid in place of another; by default as fine"),
    ] = None
    start: Annotated[Annotated[float, Field(ge=-1e12, le=1e12)] | str, BeforeValidator(_as_written)] = Field(
        0.0, description="of the samples when the shot starts: seconds, or a date such as 2019-03-01"
    )

    _start: float | None = PrivateAttr(None)
    _samples: Samples = PrivateAttr()
    _context: ParseContext = PrivateAttr()

    @model_validator(mode="after")
    def _are_readable(self, info: ValidationInfo) -> Self:
        self._context = context = ParseContext.of(info)
        paths = files_named(self.file, context)
        if is_stored(paths[0]):
            if self.array is not None:
                raise UsageError(f"{paths[0]}: array does not apply. Write variables: {{x: NAME, y: NAME}}.")
            others = [files_named(name, context) for name in self.also or ()]
            if any(len(other) != len(paths) for other in others):
                counts = " and ".join(str(len(each)) for each in (paths, *others))
                raise UsageError(f"file and also name {counts} files. Name as many of each component.")
            samples, notes = cf_samples(paths, self._selection(), self._placing(), *others)
            self._samples = samples
            context.notes.extend(notes)
            if isinstance(self.start, str):
                self._start = samples.seconds_of(self.start)
            self._note_files(0, 0)
            return self
        if isinstance(self.start, str):
            raise UsageError(f"{paths[0]}: its times have no dates. Write start in seconds.")
        given = [
            name
            for name in _OF_STORED
            if getattr(self, name) != type(self).model_fields[name].get_default(call_default_factory=True)
        ]
        if given:
            raise UsageError(
                f"{paths[0]}: {given[0]} does not apply; it is for NetCDF, HDF5 and Zarr. Remove it."
            )
        read = read_samples(paths, self.array, float(self.interval), self.resolution)
        self._samples = read.samples
        context.digests.update(read.files)
        context.notes.extend(read.notes)
        return self

    def _selection(self) -> Selection:
        named = {} if self.variables is None else self.variables.model_dump(exclude_none=True)
        if self.variables is not None and len(named) < 2:
            raise UsageError("variables: a velocity has at least two components. Write {x: NAME, y: NAME}.")
        at = tuple((self.at or {}).items())
        return Selection(
            tuple(named.items()), at, self.group, float(self.interval), self.along, self.resolution
        )

    def _placing(self) -> Placing:
        return Placing(self.map, self.up, self.fit, float(self.exaggerate), self.land)

    def _note_files(self, first: int, last: int, samples: Samples | None = None) -> None:
        noted = self._samples if samples is None else samples
        assert isinstance(noted, WindowedSamples)
        for index in range(first, last + 1):
            self._context.digests.update(noted.files(index))

    @staticmethod
    def _span(flow: Sampled, clock: Clock) -> tuple[int, int]:
        """Return the first and the last time of the samples that frames may show."""
        ends = clock.frames.first - 1, clock.frames.last + 1
        frames = [ends[0], *clock.frames, ends[1]]
        times = [index for frame in frames for index in flow.moment(clock.flow_time(frame))[:2]]
        if flow.loop and max(times) - min(times) > 1:
            times += [0, len(flow.samples.times) - 1]
        return min(times), max(times)

    def variable_field(self, variable: str, file: str | None, clock: Clock) -> tuple[Any, str, str]:
        """Return a variable of the data, or of another file, as a field of numbers, its name and its unit."""
        name = self.file if file is None else file
        if "*" not in name and not is_there(self._context.folder / name):
            raise MissingInputError(f"file {name} is not there; it is looked for beside the shot file")
        paths = files_named(name, self._context)
        flow: Sampled = super(SampledDocument, self._started).build(clock)
        if is_stored(paths[0]):
            samples, start = self._stored_numbers(paths, variable)
            flow = replace(flow, samples=samples, start=flow.start - start)
            self._note_files(*self._span(flow, clock), samples)
            return flow, *samples.named
        read = read_samples(paths, variable, float(self.interval), self.resolution, is_number=True)
        self._context.digests.update(read.files)
        return replace(flow, samples=read.samples), variable, ""

    def _stored_numbers(self, paths: tuple[Path, ...], variable: str) -> tuple[CFNumbers, float]:
        """Return the samples of a variable on the grid of the velocities, and their delay."""
        ours, placing = self._samples, self._placing()
        if not isinstance(ours, CFSamples):
            raise UsageError(
                f"{paths[0]}: it has places of its own, and {self.file} has others. Name one like it."
            )
        if not ours.layout.is_round:
            placing = replace(placing, up="z" if ours.layout.is_upright else "y")
        selection = replace(self._selection(), variables=(("x", variable),), along="east", is_number=True)
        theirs, notes = cf_samples(paths, selection, placing, kind=CFNumbers)
        assert isinstance(theirs, CFNumbers), "that reads them"
        if not theirs.layout.is_round and not theirs.layout.is_above(ours.layout):
            raise UsageError(
                f"{paths[0]}: longitudes and latitudes of {variable} differ from those of the velocities. "
                "Put both on one grid, for example by cdo remapbil, or write map: sphere."
            )
        self._context.notes.extend(notes)
        return theirs, ours.seconds_until(theirs)

    @property
    def _started(self) -> Self:
        """The entry with its start in seconds."""
        return self if self._start is None else self.model_copy(update={"start": self._start})

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"samples": self._samples}

    def build(self, clock: Clock) -> Any:
        """Return the flow, and note the files of the times that its frames may show."""
        flow = super(SampledDocument, self._started).build(clock)
        if isinstance(self._samples, WindowedSamples):
            self._note_files(*self._span(flow, clock))
            if flow.loop:
                flow.samples.period  # noqa: B018  # raises the error of times that cannot repeat
            if self._samples.parts is not None and flow.outside != "repeat":
                flow = SampledByChunk(**{each.name: getattr(flow, each.name) for each in fields(flow)})
            if flow.samples.is_paced and "time_scale" not in self.model_fields_set:
                self._note_pace(flow.samples.times)
        return flow

    def _note_pace(self, times: Floats) -> None:
        """Say how to make data of hours and days move, where a shot does not say it."""
        interval = float(np.diff(times).min()) if len(times) > 1 else 0.0
        if self.map is not None or self.fit is not None or interval > SLOW:
            self._context.notes.append(
                f"{self.file}: a second of the shot is a second of the samples, in which hardly anything "
                "moves; write time_scale: 1 day"
            )


class AttractionDocument(OneOfSeveral, FlowParameters):
    """Attraction to points, a curve or a mesh."""

    noun, several = "the target of attraction", ("points", "curve", "mesh")

    flow = Attraction

    points: Annotated[
        list[Triple] | None, Field(min_length=1), ParameterDoc("the nearest of these attracts", "units")
    ] = None
    curve: Annotated[
        list[Triple] | None,
        Field(min_length=2),
        ParameterDoc("a smooth curve through these attracts", "units"),
    ] = None
    mesh: Annotated[str | None, ParameterDoc("the surface in this file attracts")] = None
    closed: Annotated[bool, ParameterDoc("joins the last point of the curve to the first")] = False
    scale: Annotated[Positive, ParameterDoc("factor on the mesh")] = 1.0

    _target: Target = PrivateAttr()

    @model_validator(mode="after")
    def _to_one(self, info: ValidationInfo) -> Self:
        if self.points is not None:
            self._target = Target.points(np.array(self.points))
        elif self.curve is not None:
            self._target = Target.curve(np.array(self.curve), self.closed)
        else:
            file = ParseContext.of(info).mesh(str(self.mesh))
            self._target = Target.surface(read_mesh(file), float(self.scale))
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"target": self._target}


class WindDocument(FlowParameters):
    flow = Wind

    through: Annotated[list[Triple], Field(min_length=2), ParameterDoc("points of the curve", "units")]

    @field_validator("through")
    @classmethod
    def _has_directions(cls, through: list[list[float]]) -> list[list[float]]:
        for point, following in pairwise(through):
            if point == following:
                raise UsageError(
                    f"the curve goes through {point} twice in a row, so it has no direction there. "
                    "Remove one."
                )
        return through

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"through": tuple((float(x), float(y), float(z)) for x, y, z in self.through)}
