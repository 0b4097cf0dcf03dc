"""What a shot file says under `resample`, and the resampling it becomes.

Angles are degrees in the file and radians from here on.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from pipeline.arrays import AnyArray, Points
from pipeline.flow.keyframes import Curve, Number, VectorParameter, number_at, vector_at
from pipeline.formula import PLACE, Expression
from pipeline.mesh.pn_triangles import MOST_PIECES
from pipeline.resample import Curvature, DistanceToCamera, Formula, Thresholds
from pipeline.resample.sizing_field import FORMULA_NAMES
from pipeline.resample.thresholds import DEFAULT_HARD_ANGLE, Threshold
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import Keyed, NotNegative, PlaceField, PositiveField, number, place
from pipeline.shot.documents.fields import (
    A_NUMBER_TOO,
    DEGREE,
    Document,
    Positive,
    Told,
    exactly_one,
    one_of,
    over,
)
from pipeline.shot.motion import Resampling

Angle = Annotated[float, Field(gt=0, lt=180)]
ThresholdText = Annotated[str, A_NUMBER_TOO, over(FORMULA_NAMES)]


@dataclass(frozen=True)
class KeyedThreshold:
    """A threshold that is the same everywhere and changes in time."""

    value: Curve

    def at(self, frame: int, time: float) -> float:
        return number_at(self.value, time)


@dataclass(frozen=True)
class KeyedCamera:
    """A `DistanceToCamera` whose camera moves: the same parameters, constant or keyed."""

    position: VectorParameter
    pixels: Number
    finest: float
    coarsest: float
    field_of_view: Number
    width: float

    def at(self, frame: int, time: float) -> DistanceToCamera:
        return DistanceToCamera(
            vector_at(self.position, time),
            number_at(self.pixels, time),
            self.finest,
            self.coarsest,
            number_at(self.field_of_view, time),
            self.width,
        )


@dataclass(frozen=True)
class WithinFormula:
    """A region: where a formula over x, y and z is true, or not 0."""

    text: str
    _expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_expression", Expression(self.text, PLACE))

    def __call__(self, points: Points) -> AnyArray:
        """(N,) flags of points (N, 3). Raises UsageError where the formula is not finite."""
        x, y, z = points.T
        found: AnyArray = self._expression(x=x, y=y, z=z) != 0
        return found


class CurvatureDocument(Document):
    tolerance: Positive
    finest: Positive
    coarsest: Positive


class CameraDistanceDocument(Document):
    """field_of_view: degrees"""

    position: PlaceField
    pixels: PositiveField
    finest: Positive
    coarsest: Positive
    field_of_view: PositiveField = 26.0
    width: Positive = 1920.0

    def build(self, clock: Clock) -> Threshold:
        camera = KeyedCamera(
            place(self.position, clock),
            number(self.pixels, clock),
            float(self.finest),
            float(self.coarsest),
            number(self.field_of_view, clock, DEGREE),
            float(self.width),
        )
        moves = any(isinstance(v, Curve) for v in (camera.position, camera.pixels, camera.field_of_view))
        return camera if moves else camera.at(clock.frames.first, 0.0)


class ActiveAngleDocument(Document):
    """A hard angle that is a function; the formula's value is in degrees."""

    formula: ThresholdText


class ActiveLengthDocument(Document):
    """A length that is a function: exactly one of these."""

    model_config = exactly_one("formula", "curvature", "camera")

    formula: ThresholdText | None = None
    curvature: CurvatureDocument | None = None
    camera: CameraDistanceDocument | None = None

    @model_validator(mode="after")
    def _names_one(self) -> ActiveLengthDocument:
        named = [name for name in sorted(self.model_fields_set) if getattr(self, name) is not None]
        if len(named) != 1:
            raise PydanticCustomError(
                "one_length",
                "a length is one of formula, curvature, camera or keys, and this has {found}. Write one.",
                {"found": " and ".join(named) or "nothing"},
            )
        return self


def _form(value: Any) -> str:
    return "plain" if not isinstance(value, dict) else "keyed" if "keys" in value else "active"


LengthField = Annotated[
    Annotated[Positive, Tag("plain")]
    | Annotated[Keyed[Positive], Tag("keyed")]
    | Annotated[ActiveLengthDocument, Tag("active")],
    Discriminator(_form),
]
ShortestField = Annotated[
    Annotated[NotNegative, Tag("plain")]
    | Annotated[Keyed[NotNegative], Tag("keyed")]
    | Annotated[ActiveLengthDocument, Tag("active")],
    Discriminator(_form),
]
AngleField = Annotated[
    Annotated[Angle, Tag("plain")]
    | Annotated[Keyed[Angle], Tag("keyed")]
    | Annotated[ActiveAngleDocument, Tag("active")],
    Discriminator(_form),
]


class RegionDocument(Document):
    """Where a formula holds at rest: there is no moment that it could speak of."""

    formula: Annotated[str, A_NUMBER_TOO, over(PLACE)]


CreasesField = Annotated[
    Annotated[str, one_of(("rest", "model", "none"), "source of creases"), Tag("plain")]
    | Annotated[RegionDocument, Tag("active")],
    Discriminator(lambda value: "active" if isinstance(value, dict) else "plain"),
]


class ResampleDocument(Document):
    """Settings that are left out take the defaults of `Thresholds` and `Resampling`."""

    renamed: ClassVar[Mapping[str, str]] = {"renew": "rest_interval", "shape": "min_roundness"}

    max_edge_length: LengthField
    min_edge_length: ShortestField | None = None
    hard_angle: AngleField = 40.0
    max_vertices: Annotated[int, Field(ge=4)] | None = None
    gradation: Annotated[Positive, Field(le=100)] | None = None
    method: Annotated[str, one_of(("triangles", "polyhedra"), "method")] | None = None
    placement: Annotated[str, one_of(("chord", "curved", "exact"), "placement")] | None = None
    splits: Annotated[str, one_of(("edges", "faces"), "way to split")] | None = None
    min_roundness: Annotated[float, Field(ge=0, le=1)] | None = None
    normals: Annotated[str, one_of(("carried", "geometric"), "kind of normals")] | None = None
    rest_interval: Annotated[int, Field(ge=1)] | None = None
    creases: CreasesField | None = None
    cutting: Annotated[str, one_of(("slice", "recurse"), "way to cut")] | None = None
    collapse: Annotated[str, one_of(("edges", "areas"), "thing to collapse")] | None = None

    def build(self, clock: Clock) -> Resampling:
        angle = _angle(self.hard_angle, clock)
        crease = angle if isinstance(angle, float) else DEFAULT_HARD_ANGLE
        shortest = self.min_edge_length
        thresholds = Thresholds(
            _length(self.max_edge_length, clock, crease),
            None if shortest is None else _length(shortest, clock, crease),
            angle,
            **self._given("max_vertices", "gradation"),
        )
        settings = [field.name for field in fields(Resampling) if field.name != "thresholds"]
        given = self._given(*settings)
        if isinstance(self.creases, RegionDocument):
            given["creases"] = WithinFormula(self.creases.formula)
        return Resampling(thresholds, **given)

    def _given(self, *names: str) -> dict[str, Any]:
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def _length(value: float | Keyed[Any] | ActiveLengthDocument, clock: Clock, hard_angle: float) -> Threshold:
    """A parsed length; `hard_angle` tells curvature what a crease is."""
    if not isinstance(value, ActiveLengthDocument):
        return _keyed(number(value, clock))
    if value.formula is not None:
        return Formula(value.formula)
    if value.camera is not None:
        return value.camera.build(clock)
    assert value.curvature is not None, "exactly one is named"
    sizes = value.curvature
    return Curvature(float(sizes.tolerance), float(sizes.finest), float(sizes.coarsest), hard_angle)


def _angle(value: float | Keyed[Any] | ActiveAngleDocument, clock: Clock) -> Threshold:
    if isinstance(value, ActiveAngleDocument):
        return Formula(value.formula, unit=DEGREE)
    return _keyed(number(value, clock, DEGREE))


def _keyed(value: Number) -> Threshold:
    return KeyedThreshold(value) if isinstance(value, Curve) else value


_PIXELS = r"^\s*(\d+\.?\d*|\.\d+)\s*px\s*$"


def _pixels(value: Any) -> Any:
    """`2px` as 2.0."""
    if not isinstance(value, str):
        return value
    match = re.match(_PIXELS, value)
    if not match:
        raise PydanticCustomError(
            "pixels", "{text} is no length in pixels. Write 2px.", {"text": repr(value)}
        )
    return float(match[1])


Pixels = Annotated[
    float,
    BeforeValidator(_pixels),
    Field(ge=0.25, le=1000),
    Told(type=["number", "string"], pattern=_PIXELS),
]


class SmoothDocument(Document):
    """Pieces of each edge by their number, or by how long they are in the picture."""

    tessellate: Annotated[int, Field(ge=1, le=MOST_PIECES)] | None = None
    dicing: Pixels | None = None

    @model_validator(mode="after")
    def _says_one(self) -> SmoothDocument:
        if self.tessellate is not None and self.dicing is not None:
            raise PydanticCustomError(
                "two_measures",
                "two measures: tessellate, a number of pieces, and dicing, how long they are in the picture. "
                "Remove one of them.",
            )
        return self
