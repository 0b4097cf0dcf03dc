"""The flows that a shot writes out or takes from files: formulas, targets, curves, samples, Python."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from pipeline.flow.catalogue.attraction import Attraction, Target
from pipeline.flow.catalogue.curl_noise import CurlNoise
from pipeline.flow.catalogue.formula import MOST_NUMBERS, Formula
from pipeline.flow.catalogue.sampled import Sampled, SampledFiles
from pipeline.flow.catalogue.wind import Wind
from pipeline.flow.python_file import PythonFlow
from pipeline.flow.python_file import digest_of as digest_of_code
from pipeline.flow.samples import digest_of
from pipeline.formula import FUNCTIONS, Expression, FormulaError
from pipeline.formula.blocks import KNOWN
from pipeline.formula.words import CONSTANTS
from pipeline.mesh.io import read_mesh
from pipeline.shot.clock import Clock
from pipeline.shot.curves import NumberField, PlaceField, PositiveField, number, place
from pipeline.shot.fields import Document, Positive, Real, Triple, vector
from pipeline.shot.regions import HERE
from pipeline.shot.surroundings import Surroundings, finding, told


def _as_text(value: Any) -> Any:
    """`0` and `0.5` are formulas too."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _names_a_number(word: str) -> str:
    if not word.isidentifier() or word in {*KNOWN, *CONSTANTS, *FUNCTIONS}:
        raise finding(f"{word!r} cannot name a number: it is no word, or has a meaning. Choose another.")
    return word


def _readable(text: str, info: ValidationInfo) -> str:
    if "numbers" not in info.data:
        return text  # what is wrong with these is told; who knows which words they were to be
    try:
        Expression(text, (*KNOWN, *info.data["numbers"]))
    except FormulaError as error:
        what = {"message": error.message, "column": error.column}
        raise PydanticCustomError("formula", "{message}", what) from None
    return text


Text = Annotated[str, BeforeValidator(_as_text), AfterValidator(_readable)]


class FormulaDocument(Document):
    """`[-y, x, 0.3 * sin(t)]`, or with words of its own under `with`; these are read first."""

    numbers: dict[Annotated[str, AfterValidator(_names_a_number)], NumberField] = Field(
        default_factory=dict, alias="with", max_length=MOST_NUMBERS
    )
    velocity: Annotated[list[Text], Field(min_length=3, max_length=3)]
    extent: Positive = 2.0

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`formula: [a, b, c]` is `formula: {velocity: [a, b, c]}`."""
        return {"velocity": value} if isinstance(value, list) else value

    def build(self, clock: Clock) -> Formula:
        u, v, w = self.velocity
        numbers = tuple((name, number(value, clock)) for name, value in self.numbers.items())
        return Formula((u, v, w), numbers, float(self.extent))


class CurlNoiseDocument(Document):
    size: PositiveField = 1.0
    strength: NumberField = 1.0
    octaves: Annotated[int, Field(ge=1, le=12)] = 3
    roughness: Annotated[float, Field(ge=0, le=1)] = 0.5
    lacunarity: Annotated[float, Field(ge=1, le=8)] = 2.0
    evolution: Real = 0.5
    seed: Annotated[int, Field(ge=0, le=2**53)] = 0

    def build(self, clock: Clock) -> CurlNoise:
        shape = self.octaves, float(self.roughness), float(self.lacunarity), float(self.evolution), self.seed
        return CurlNoise(number(self.size, clock), number(self.strength, clock), *shape)


class AttractionDocument(Document):
    """To points, a curve or a mesh: exactly one of them."""

    points: Annotated[list[Triple], Field(min_length=1)] | None = None
    curve: Annotated[list[Triple], Field(min_length=2)] | None = None
    mesh: str | None = None
    closed: bool = False
    scale: Positive = 1.0
    rate: NumberField = 1.0
    radius: PositiveField = 1.0

    _target: Target = PrivateAttr()

    @model_validator(mode="after")
    def _to_one(self, info: ValidationInfo) -> AttractionDocument:
        given = [name for name in ("points", "curve", "mesh") if getattr(self, name) is not None]
        if len(given) != 1:
            raise finding(
                f"it goes to one of points, curve and mesh, not to {' and '.join(given) or 'none'}; write one"
            )
        if self.points is not None:
            self._target = Target.points(np.array(self.points))
        elif self.curve is not None:
            self._target = Target.curve(np.array(self.curve), self.closed)
        else:
            file = Surroundings.of(info).file(str(self.mesh))
            self._target = told(lambda: Target.surface(read_mesh(file), float(self.scale)))
        return self

    def build(self, clock: Clock) -> Attraction:
        return Attraction(self._target, number(self.rate, clock), number(self.radius, clock))


class WindDocument(Document):
    through: Annotated[list[Triple], Field(min_length=2)]
    speed: NumberField = 1.0
    radius: PositiveField = 1.0
    closed: bool = False

    @model_validator(mode="after")
    def _goes_somewhere(self) -> WindDocument:
        for here, there in zip(self.through, self.through[1:], strict=False):
            if here == there:
                raise finding(
                    f"the curve goes through {here} twice in a row; it stands still there. Remove one."
                )
        return self

    def build(self, clock: Clock) -> Wind:
        through = tuple(vector(point) for point in self.through)
        return Wind(through, number(self.speed, clock), number(self.radius, clock), self.closed)


class SampledDocument(Document):
    """Files are read when the shot is: what is wrong with them is told with the shot."""

    file: str
    array: str | None = None
    interval: Positive = 1.0
    between: Literal["linear", "cubic"] = "linear"
    outside: Literal["clamp", "zero", "repeat"] = "clamp"
    centre: PlaceField = HERE
    scale: PositiveField = 1.0
    strength: NumberField = 1.0
    time_scale: Real = 1.0
    start: Real = 0.0
    loop: bool = False

    _files: SampledFiles = PrivateAttr()

    @model_validator(mode="after")
    def _sound(self, info: ValidationInfo) -> SampledDocument:
        paths = Surroundings.of(info).files(self.file)
        self._files = told(lambda: SampledFiles(digest_of(paths), self.array, float(self.interval), paths))
        told(lambda: self._files.samples)
        return self

    def build(self, clock: Clock) -> Sampled:
        return Sampled(
            self._files,
            self.between,
            self.outside,
            place(self.centre, clock),
            number(self.scale, clock),
            number(self.strength, clock),
            float(self.time_scale),
            float(self.start),
            self.loop,
        )


class PythonDocument(Document):
    """Only looked at here; to run it needs permission."""

    file: str
    function: str

    _path: Path = PrivateAttr()
    _allowed: bool = PrivateAttr()

    @model_validator(mode="after")
    def _there(self, info: ValidationInfo) -> PythonDocument:
        surroundings = Surroundings.of(info)
        self._path, self._allowed = surroundings.file(self.file), surroundings.allow_code
        if not self.function.isidentifier():
            raise finding(f"{self.function!r} names no function; write it as in the file, without brackets.")
        return self

    def build(self, clock: Clock) -> PythonFlow:
        return PythonFlow(self.function, digest_of_code(self._path), self._path, self._allowed)
