"""The subjects of a shot file that grow from seeds: stream, path and streak surfaces, and lines."""

from __future__ import annotations

import hashlib
import math
from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flowsculpt import Streamlines, Sum, Thresholds, UsageError, VelocityField
from flowsculpt.api import MovingKind, plural
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import (
    ByForm,
    Clock,
    Document,
    FlowParameters,
    OneOfSeveral,
    Positive,
    RegionDocument,
    SurfaceSequence,
    Triple,
    VelocityDocument,
    one_of,
)
from flowsculpt.pipeline.plugins.streams.data_units import in_units_of_data
from flowsculpt.pipeline.plugins.streams.released_lines import PathLines, ReleasedLines, StreakLines
from flowsculpt.pipeline.plugins.streams.released_surfaces import PathSurface, ReleasedSurface, StreakSurface
from flowsculpt.pipeline.plugins.streams.seed_curves import SeedCircle, SeedCurve, Seeds
from flowsculpt.pipeline.plugins.streams.seeded_sequence import CUT, Released, SeededSequence
from flowsculpt.pipeline.plugins.streams.stream_values import NAMES, StreamValues

Maker = Callable[[Streamlines, float], Released]
"""Returns a surface, or lines, of a flow and the time of the first release, in seconds."""

_ACROSS = 40  # edges along the seeds, where the shot names no length
_ROUND = 200  # radii of a tube along the seeds, where the shot names no radius
_A_TURN = 24  # points of a spiral through which a smooth curve goes
_COMPARED = 257  # points of the seeds by which keys know them


class CircleDocument(Document):
    """A circle of seeds."""

    radius: Positive = Field(1.0, description="units")
    centre: Triple = Field([0.0, 0.0, 0.0], description="units")
    normal: Triple = Field([0.0, 1.0, 0.0], description="along its axis")

    def build(self) -> SeedCircle:
        axis = np.array(self.normal, np.float64)
        size = np.linalg.norm(axis)
        if not size:
            raise UsageError("the normal of the circle has no direction. Write normal: [0, 1, 0].")
        aside = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
        first = aside / np.linalg.norm(aside)
        axes = np.stack([first, np.cross(axis / size, first)])
        return SeedCircle(np.array(self.centre, np.float64), float(self.radius), axes)


class SphereSpiralDocument(Document):
    """A spiral on a sphere from pole to pole, with turns equally far apart: seeds all over a globe."""

    radius: Positive = Field(1.0, description="units")
    centre: Triple = Field([0.0, 0.0, 0.0], description="units")
    turns: Annotated[int, Field(ge=1, le=100)] = Field(12, description="around y")

    def build(self) -> SeedCurve:
        pieces = _A_TURN * self.turns
        polar = np.pi * np.linspace(0.5 / self.turns, 1.0 - 0.5 / self.turns, pieces + 1)
        angle = 2.0 * self.turns * polar
        around = np.sin(polar)
        through = np.column_stack([around * np.sin(angle), np.cos(polar), around * np.cos(angle)])
        return SeedCurve(np.array(self.centre) + float(self.radius) * through, is_smooth=True)


class SeedsDocument(OneOfSeveral):
    """A curve that releases points."""

    example = "{line: [[-1, 0, 0], [1, 0, 0]]}"
    noun, several = "a curve of seeds", ("line", "curve", "circle", "spiral", "file")

    line: Annotated[list[Triple] | None, Field(min_length=2)] = Field(
        None, description="straight from point to point (units)"
    )
    curve: Annotated[list[Triple] | None, Field(min_length=2)] = Field(
        None, description="smooth through points (units)"
    )
    circle: CircleDocument | None = Field(None, description="a circle")
    spiral: SphereSpiralDocument | None = Field(None, description="a spiral all over a sphere")
    file: str | None = Field(
        None, description="straight through the points of a text file, three numbers a line (units)"
    )
    closed: bool = Field(False, description="of a line, curve or file: joins the last point to the first")

    def build(self, folder: Path) -> Seeds:
        """Return the curve. Raises UsageError or MissingInputError where it cannot be made."""
        for whole in (self.circle, self.spiral):
            if whole is not None:
                return whole.build()
        if self.file is not None:
            through = _points_of(folder / self.file)
        else:
            through = np.array(self.line or self.curve, np.float64)
        steps = np.diff(np.concatenate([through, through[:1]]) if self.closed else through, axis=0)
        again = np.flatnonzero(~steps.any(axis=1))
        if len(again):
            place = ", ".join(f"{x:g}" for x in through[again[0]])
            raise UsageError(f"the curve of seeds goes through ({place}) twice in a row. Remove one.")
        return SeedCurve(through, self.closed, self.curve is not None)


def _points_of(path: Path) -> Floats:
    """Return the points (N, 3) of a text file."""
    text = InputFile(path).content().decode("utf-8", "replace")
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    try:
        points = np.array(rows, np.float64)
    except ValueError:
        points = np.empty((0, 0))
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 2 or not np.isfinite(points).all():
        raise UsageError(f"{path.name}: a curve of seeds is two or more lines of three numbers each")
    return points


class VariableDocument(Document):
    """A variable of the data that the velocities come from."""

    example = "{variable: temperature}"

    variable: str = Field(description="its name in the file")
    file: str | None = Field(None, description="another file with it, on the same axes of space and time")


Lifetime = Annotated[Positive | None, Field(description="how long points travel; by default without end (s)")]
Length = Annotated[Positive, Field(description="of travel along the streamlines (s)")]
Values = Annotated[
    Annotated[str, one_of(NAMES, "measure")] | VariableDocument | None,
    Field(description="what look: {measure: {values: {}}} shows: a measure, or a variable of the data"),
    ByForm(lambda value: 2 if value is None else not isinstance(value, str)),
]
Direction = Annotated[Literal["forwards", "backwards", "both"], Field(description="of travel")]
Begin = Annotated[
    Annotated[float, Field(lt=0, ge=-1e6)] | None,
    Field(
        description="when points are released first; the first frame is at 0; by default a frame before (s)"
    ),
]

_OF_FILES = ("up", "repair", "paint", "fit")
"""Settings of subjects from files alone."""


class _FromSeeds(MovingKind):
    """Base of the subjects that grow from seeds; each adds one field, by whose name shots know it."""

    velocity: Annotated[
        list[VelocityDocument],
        Field(min_length=1, description="velocity fields that act together, as under sum"),
    ]
    within: RegionDocument | None = Field(
        None, description="the region in which points move; those that leave it stop"
    )
    max_edge_length: Positive | None = Field(
        None, description="the longest edge; by default a fortieth of the length of the seeds (units)"
    )
    values: Values = None

    @classmethod
    def word(cls) -> str:
        return next(name for name in cls.model_fields if name.endswith(("_surface", "_lines")))

    @abstractmethod
    def maker(self, seeds: Seeds) -> Maker:
        """Return what makes the surface, or the lines."""

    def surfaces(self, folder: Path, clock: Clock) -> SurfaceSequence:
        given: Any = self
        for name in _OF_FILES:
            if name in self.model_fields_set:
                raise UsageError(f"{name} is for models from files, and this is made of seeds. Leave it out.")
        word = self.word()
        seeds: Seeds = getattr(given, word).build(folder)
        begin = None if word.startswith("stream") else _begin(given.begin, clock)
        lifetime = getattr(given, "length", None)
        left_out = {word, "velocity", "begin", "length", "thickness", "within"}
        left_out |= MovingKind.model_fields.keys() | (set() if self.values else {"values"})
        kind: Any = next(each for each in type(self).__mro__ if each.__module__ == __name__)
        plain = self.model_dump(mode="json", include=kind.model_fields.keys() - left_out)
        points = seeds.points(np.linspace(0.0, seeds.length, _COMPARED))
        fields, region = self.velocity, None
        if self.within is not None:
            within = self._softened(seeds)
            region = within.build(clock)
            if not (region.weight(points, clock.flow_time(clock.frames.first)) > CUT).any():
                raise UsageError("no seed is in the region of within. Make it larger, or place it elsewhere.")
            fields = [VelocityDocument.model_validate({"within": {"region": within, "flows": fields}})]
        velocity = Sum(tuple(entry.build(clock) for entry in fields))
        return SeededSequence(
            word=word,
            make=self.maker(seeds),
            settings=[plain, hashlib.sha256(points.tobytes()).hexdigest(), seeds.length, seeds.is_closed],
            flow=Streamlines(velocity),
            times=tuple(map(clock.flow_time, clock.frames)),
            begin=begin,
            length=math.inf if lifetime is None else float(lifetime),
            direction=getattr(given, "direction", "forwards"),
            thickness=float(getattr(given, "thickness", None) or 0.0),
            values=self._measured(seeds, clock, velocity),
            region=region if word.endswith("surface") else None,
        )

    def _measured(self, seeds: Seeds, clock: Clock, velocity: VelocityField) -> StreamValues | None:
        """Return what is measured, if anything is. Raises UsageError for a variable that the data lack."""
        if self.values is None:
            return None
        if isinstance(self.values, str):
            label, unit = NAMES[self.values]
            unit, factor = in_units_of_data(self.values, unit, velocity)
            return StreamValues(self.values, label, unit, self.longest(seeds), factor=factor)
        flows = [entry.chosen for entry in self.velocity if isinstance(entry.chosen, FlowParameters)]
        with_data = [each for each in flows if type(each).variable_field is not FlowParameters.variable_field]
        if len(with_data) != 1:
            entries = plural(len(with_data), "entry", "entries")
            raise UsageError(
                f"values are a variable of the data of velocity, and that has {entries} with data. Write "
                "one, as in velocity: [{sampled: {file: ocean.nc}}]."
            )
        numbers, label, unit = with_data[0].variable_field(self.values.variable, self.values.file, clock)
        least = (
            0.5 if getattr(numbers, "between", "") == "cubic" else 1e-4
        )  # beside missing nodes splines overshoot
        return StreamValues(self.values.variable, label, unit, self.longest(seeds), numbers, least)

    def longest(self, seeds: Seeds) -> float:
        """Return the longest edge, units."""
        return float(self.max_edge_length or seeds.length / _ACROSS)

    def _softened(self, seeds: Seeds) -> RegionDocument:
        """Return the region; without a falloff it gets one as wide as an edge, in which points slow down."""
        assert self.within is not None
        if "falloff" in self.within.model_fields_set:
            return self.within
        return self.within.model_copy(update={"falloff": self.longest(seeds)})


def _begin(begin: float | None, clock: Clock) -> float:
    before = clock.flow_time(clock.frames.first - 1)
    return begin if begin is not None else before if before < 0.0 else -1.0 / float(clock.rate.fps)


class _Surface(_FromSeeds):
    """Base of surfaces."""

    kind: ClassVar[type[ReleasedSurface]] = PathSurface

    length: Lifetime = None
    tolerance: Positive | None = Field(
        None, description="how far edges may be off the surface; by default max_edge_length / 800 (units)"
    )
    tear: Annotated[float, Field(gt=1, le=1e6)] | None = Field(
        None, description="leaves out what stretches the seeds to more than so many times their length"
    )
    thickness: Positive | None = Field(
        None, description="makes a closed shell of the surface; by default it is open (units)"
    )

    def maker(self, seeds: Seeds) -> Maker:
        return partial(
            self.kind,
            seeds,
            thresholds=Thresholds(self.longest(seeds)),
            tear=math.inf if self.tear is None else float(self.tear),
            length=math.inf if self.length is None else float(self.length),
            tolerance=None if self.tolerance is None else float(self.tolerance),
        )


class _Lines(_FromSeeds):
    """Base of lines."""

    kind: ClassVar[type[ReleasedLines]] = PathLines

    length: Lifetime = None
    count: Annotated[int, Field(ge=1, le=10_000, description="lines, evenly along the seeds")] = 24
    radius: Positive | None = Field(
        None, description="of the tubes; by default a 200th of the length of the seeds (units)"
    )
    flatten: Annotated[float, Field(gt=0, le=1)] = Field(
        1.0, description="thickness over width: 1 is a round tube, 0.1 a ribbon along the seeds"
    )
    taper: Annotated[float, Field(gt=0, le=1)] = Field(
        1.0, description="width where points come from over that where they go: 0.2 shows the direction"
    )

    def maker(self, seeds: Seeds) -> Maker:
        return partial(
            self.kind,
            seeds,
            count=self.count,
            longest=self.longest(seeds),
            radius=float(self.radius or seeds.length / _ROUND),
            flatten=self.flatten,
            taper=self.taper,
            length=math.inf if self.length is None else float(self.length),
        )


class StreakSurfaceDocument(_Surface):
    """All points that a curve has released so far, as smoke from a row of nozzles."""

    example = "{streak_surface: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}]}"
    kind = StreakSurface

    streak_surface: SeedsDocument = Field(description="the curve that releases points")
    begin: Begin = None


class PathSurfaceDocument(_Surface):
    """The paths of the points that a curve has released at one time."""

    example = "{path_surface: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}]}"

    path_surface: SeedsDocument = Field(description="the curve that releases points")
    begin: Begin = None


class StreamSurfaceDocument(_Surface):
    """The streamlines through a curve, of the velocities as they are in each frame."""

    example = "{stream_surface: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], length: 2}"

    stream_surface: SeedsDocument = Field(description="the curve that streamlines go through")
    length: Length = 2.0
    direction: Direction = "forwards"


class StreakLinesDocument(_Lines):
    """Streaks: lines of the points that seeds have released so far, as tubes."""

    example = "{streak_lines: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], count: 30}"
    kind = StreakLines

    streak_lines: SeedsDocument = Field(description="the curve that releases points")
    begin: Begin = None


class PathLinesDocument(_Lines):
    """Paths of points that seeds have released at one time, as tubes."""

    example = "{path_lines: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], count: 30}"

    path_lines: SeedsDocument = Field(description="the curve that releases points")
    begin: Begin = None


class StreamLinesDocument(_Lines):
    """Streamlines of the velocities as they are in each frame, as tubes."""

    example = "{stream_lines: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], length: 2}"

    stream_lines: SeedsDocument = Field(description="the curve that streamlines go through")
    length: Length = 2.0
    direction: Direction = "forwards"
