"""The entry `resample` of a shot file, and the resampling it becomes.

Angles are degrees in the file and radians in the code.
"""

import inspect
import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.flow.parameters import Curve, Number, VectorParameter, number_at, vector_at
from flowsculpt.pipeline.formula import PLACE, Expression
from flowsculpt.pipeline.resample import (
    Curvature,
    DistanceToCamera,
    ThresholdFormula,
    Thresholds,
    polygon_methods,
)
from flowsculpt.pipeline.resample.thresholds import DEFAULT_HARD_ANGLE, FORMULA_NAMES, Threshold
from flowsculpt.pipeline.shot.documents.curves import (
    ABOVE_0,
    NOT_BELOW_0,
    Bounds,
    FromSound,
    Keyed,
    NotNegative,
    PlaceField,
    PositiveField,
    number,
    place,
    within,
)
from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    MAPPING_IS_SECOND,
    ByForm,
    Document,
    NumberOrText,
    OneOfSeveral,
    Positive,
    ZeroToOne,
    formula_over,
    one_of,
    optional,
)
from flowsculpt.pipeline.shot.motion import Clock, Resampling

HardAngle = Annotated[float, Field(gt=0, lt=180)]
_ANGLES = Bounds(math.ulp(0.0), math.nextafter(180.0, 0.0), "above 0 and below 180")
ThresholdText = Annotated[NumberOrText, formula_over(FORMULA_NAMES)]


@dataclass(frozen=True)
class KeyedThreshold:
    """A threshold that is the same everywhere and changes over time."""

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
    """The region where a formula over x, y and z is true, or not 0."""

    text: str
    _expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_expression", Expression(self.text, PLACE))

    def __call__(self, points: Points) -> AnyArray:
        """Return (N,) flags of points (N, 3). Raises UsageError where the formula is not finite."""
        x, y, z = points.T
        return self._expression(x=x, y=y, z=z) != 0


class CurvatureDocument(Document):
    tolerance: Positive = Field(description="largest distance from an edge's middle to the surface (units)")
    finest: Positive = Field(description="no edge is made shorter (units)")
    coarsest: Positive = Field(description="nor longer (units)")


class CameraDistanceDocument(Document):
    position: PlaceField = Field(description="of the camera (units)")
    pixels: PositiveField = Field(description="length of edges in the picture (pixels)")
    finest: Positive = Field(description="no edge is made shorter (units)")
    coarsest: Positive = Field(description="nor longer (units)")
    field_of_view: PositiveField = Field(26.0, description="horizontal (degrees)")
    width: Positive = Field(1920.0, description="of the picture (pixels)")

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
    """A hard angle that is a function of place and time."""

    formula: ThresholdText = Field(description="over x, y, z, frame and t, seconds (degrees)")


class ActiveLengthDocument(OneOfSeveral):
    """A length that is a function: one of these."""

    noun, several = "a length without keys", ("formula", "curvature", "camera")

    formula: ThresholdText | None = optional("over x, y, z, frame and t, seconds (units)")
    curvature: CurvatureDocument | None = optional("longer where the surface is flatter")
    camera: CameraDistanceDocument | None = optional("of a constant size in a picture")


def _form(value: Any) -> int:
    """Return which member of a threshold's union a value is."""
    return 0 if not isinstance(value, dict) else 1 if "keys" in value else 3 if "audio" in value else 2


_FORM = ByForm(_form)

LengthField = Annotated[
    Positive | Keyed[Positive] | ActiveLengthDocument | Annotated[FromSound, within(ABOVE_0)], _FORM
]
ShortestField = Annotated[
    NotNegative | Keyed[NotNegative] | ActiveLengthDocument | Annotated[FromSound, within(NOT_BELOW_0)], _FORM
]
HardAngleField = Annotated[
    HardAngle | Keyed[HardAngle] | ActiveAngleDocument | Annotated[FromSound, within(_ANGLES)], _FORM
]


class CreaseRegionDocument(Document):
    """Edges that stay hard by their place at rest, whatever the time."""

    formula: Annotated[NumberOrText, formula_over(PLACE)] = Field(
        description="over x, y and z: edges stay hard where it holds at rest"
    )


CreasesField = Annotated[
    Annotated[str, one_of(("rest", "model", "none"), "source of creases")] | CreaseRegionDocument,
    MAPPING_IS_SECOND,
]


METHODS = polygon_methods()


def _describe(method: str) -> str:
    """Return the name of a plug-in's method and the first line of its docstring."""
    line = inspect.cleandoc(METHODS[method].__doc__ or "").partition("\n")[0]
    return f"{method}, which {line[:1].lower()}{line[1:].rstrip('.')}"


class ResampleDocument(Document):
    """Settings that are left out take the defaults of `Thresholds` and `Resampling`."""

    example = "{max_edge_length: 0.05}"

    max_edge_length: LengthField = Field(description="edges longer than this are split (units)")
    min_edge_length: ShortestField | None = optional(
        "shorter edges collapse; below half the maximum, by default 40% (units)"
    )
    hard_angle: HardAngleField = Field(
        40.0, description="edges that turn the surface by more are creases (degrees)"
    )
    max_vertices: Annotated[int, Field(ge=4)] | None = optional("a frame that needs more fails")
    max_growth: Annotated[Positive, Field(gt=1)] | None = optional(
        "a frame that needs more than this times the vertices of the first frame fails"
    )
    gradation: Annotated[Positive, Field(le=100)] | None = optional(
        "difference of lengths between the ends of an edge, as a fraction of it, at most"
    )
    method: Annotated[str, one_of(("triangles", *METHODS), "method")] | None = optional(
        "; or ".join(("triangles", *map(_describe, METHODS)))
    )
    placement: Annotated[str, one_of(("chord", "curved", "exact"), "placement")] | None = optional(
        "where new vertices go: exact, on the surface at rest; curved, on a smooth one; chord, "
        "in the middle of the edge"
    )
    splits: Annotated[str, one_of(("edges", "faces"), "way to split")] | None = optional(
        "edges in two, or faces in four (with placement: chord)"
    )
    min_roundness: ZeroToOne | None = optional("triangles less round are repaired: 0 none, 0.85 demanding")
    normals: Annotated[str, one_of(("carried", "geometric"), "kind of normals")] | None = optional(
        "carried through the flow, or of the geometry of each frame"
    )
    rest_interval: Annotated[int, Field(ge=1)] | None = optional(
        "frames after which the present surface becomes the undeformed one"
    )
    creases: CreasesField | None = optional(
        "edges that stay hard: those hard at rest, those of the model's file, a region"
    )

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
        settings = [field.name for field in fields(Resampling) if field.name not in ("thresholds", "options")]
        given = self._given(*settings)
        if method := METHODS.get(self.method or ""):
            given["options"] = tuple(method(**self._given(*method.model_fields)).model_dump().items())
        if isinstance(self.creases, CreaseRegionDocument):
            given["creases"] = WithinFormula(self.creases.formula)
        return Resampling(thresholds, **given)

    def _given(self, *names: str) -> dict[str, Any]:
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def _settings_of_methods() -> dict[str, Any]:
    """Return the fields of the settings of plug-ins' methods."""
    return {
        name: (Annotated[(info.annotation, *info.metadata)] | None, optional(info.description or name))
        for method in METHODS.values()
        for name, info in method.model_fields.items()
    }


if not TYPE_CHECKING:
    ResampleDocument = create_model("ResampleDocument", __base__=ResampleDocument, **_settings_of_methods())

ResampleField = Annotated[Literal["off"] | ResampleDocument, MAPPING_IS_SECOND]
"""The entry `resample`: off, or thresholds."""


def _length(
    value: float | Keyed[Any] | ActiveLengthDocument | FromSound, clock: Clock, hard_angle: float
) -> Threshold:
    """Return a parsed length; curvature takes edges beyond `hard_angle` as creases."""
    if not isinstance(value, ActiveLengthDocument):
        return _keyed(number(value, clock))
    if value.formula is not None:
        return ThresholdFormula(value.formula)
    if value.camera is not None:
        return value.camera.build(clock)
    assert value.curvature is not None, "exactly one is named"
    sizes = value.curvature
    return Curvature(float(sizes.tolerance), float(sizes.finest), float(sizes.coarsest), hard_angle)


def _angle(value: float | Keyed[Any] | ActiveAngleDocument | FromSound, clock: Clock) -> Threshold:
    if isinstance(value, ActiveAngleDocument):
        return ThresholdFormula(value.formula, unit=DEGREE)
    return _keyed(number(value, clock, DEGREE))


def _keyed(value: Number) -> Threshold:
    return KeyedThreshold(value) if isinstance(value, Curve) else value
