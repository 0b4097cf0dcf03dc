"""The flows a shot file can name: what each takes there, and the flow it becomes.

Angles are degrees in the file and radians from here on.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from pipeline.flow import Flow, Streamlines, Sum, VelocityField, catalogue
from pipeline.shot.clock import Clock
from pipeline.shot.field_documents import (
    AttractionDocument,
    CurlNoiseDocument,
    Formulas,
    PythonDocument,
    SampledDocument,
    WindDocument,
)
from pipeline.shot.fields import (
    DEGREE,
    Axis,
    Document,
    NumberField,
    PlaceField,
    Positive,
    PositiveField,
    Triple,
    axis,
    number,
    place,
    vector,
)

HERE = [0.0, 0.0, 0.0]


class VortexDocument(Document):
    axis: Axis = "z"
    centre: PlaceField = HERE
    radius: PositiveField = 1.0
    strength: NumberField = 1.0
    profile: Literal["lamb_oseen", "gaussian"] = "lamb_oseen"

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Vortex(
            axis(self.axis),
            place(self.centre, clock),
            number(self.radius, clock),
            number(self.strength, clock),
            self.profile,
        )


class RotationDocument(Document):
    """speed: degrees per second"""

    axis: Axis = "y"
    centre: PlaceField = HERE
    speed: NumberField

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Rotation(
            axis(self.axis), place(self.centre, clock), number(self.speed, clock, DEGREE)
        )


class TranslationDocument(Document):
    rate: PlaceField

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Translation(place(self.rate, clock))


class StrainDocument(Document):
    axis: Axis = "y"
    centre: PlaceField = HERE
    rate: NumberField

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Strain(axis(self.axis), place(self.centre, clock), number(self.rate, clock))


class ExpansionDocument(Document):
    shape: Literal["disc", "ball"] = "ball"
    axis: Axis = "z"
    centre: PlaceField = HERE
    radius: PositiveField = 1.0
    rate: NumberField

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Expansion(
            self.shape,
            axis(self.axis),
            place(self.centre, clock),
            number(self.radius, clock),
            number(self.rate, clock),
        )


class LorenzDocument(Document):
    centre: PlaceField = HERE
    sigma: NumberField = 10.0
    rho: NumberField = 28.0
    beta: NumberField = 8.0 / 3.0
    scale: PositiveField = 20.0
    time_scale: NumberField = 0.1

    def build(self, clock: Clock) -> VelocityField:
        names = ("sigma", "rho", "beta", "scale", "time_scale")
        numbers = {name: number(getattr(self, name), clock) for name in names}
        return catalogue.Lorenz(place(self.centre, clock), **numbers)


class EnrightDocument(Document):
    """period: seconds"""

    centre: PlaceField = HERE
    scale: PositiveField = 2.0
    period: Positive = 3.0

    def build(self, clock: Clock) -> VelocityField:
        return catalogue.Enright(place(self.centre, clock), number(self.scale, clock), float(self.period))


class DeformationDocument(Document):
    axis: Axis = "y"
    centre: Triple = HERE


class TwistDocument(DeformationDocument):
    """amount: degrees per unit"""

    amount: NumberField

    def build(self, clock: Clock) -> Flow:
        return catalogue.Twist(axis(self.axis), vector(self.centre), number(self.amount, clock, DEGREE))


class TaperDocument(DeformationDocument):
    amount: NumberField

    def build(self, clock: Clock) -> Flow:
        return catalogue.Taper(axis(self.axis), vector(self.centre), number(self.amount, clock))


class StretchDocument(DeformationDocument):
    amount: PositiveField
    keep_volume: bool = True

    def build(self, clock: Clock) -> Flow:
        amount = number(self.amount, clock)
        return catalogue.Stretch(axis(self.axis), vector(self.centre), amount, self.keep_volume)


class ShearDocument(DeformationDocument):
    direction: Axis = "x"
    amount: NumberField

    def build(self, clock: Clock) -> Flow:
        amount = number(self.amount, clock)
        return catalogue.Shear(axis(self.axis), vector(self.centre), amount, axis(self.direction))


_bare = BeforeValidator(lambda value: {} if value is None else value)


class VelocityDocument(Document):
    """One entry under `sum`: exactly one velocity field by its name."""

    vortex: Annotated[VortexDocument | None, _bare] = Field(None, validate_default=False)
    rotation: Annotated[RotationDocument | None, _bare] = None
    translation: Annotated[TranslationDocument | None, _bare] = None
    strain: Annotated[StrainDocument | None, _bare] = None
    expansion: Annotated[ExpansionDocument | None, _bare] = None
    lorenz: Annotated[LorenzDocument | None, _bare] = None
    enright: Annotated[EnrightDocument | None, _bare] = None
    formula: Formulas = None
    curl_noise: Annotated[CurlNoiseDocument | None, _bare] = None
    attraction: AttractionDocument | None = None
    wind: WindDocument | None = None
    sampled: SampledDocument | None = None

    @model_validator(mode="after")
    def _names_one(self) -> VelocityDocument:
        named = sorted(self.model_fields_set)
        if len(named) != 1:
            found = " and ".join(named) or "nothing"
            raise PydanticCustomError(
                "one_flow",
                "a flow is one name and its parameters, and this entry has {found}. "
                "Start each flow with a dash of its own.",
                {"found": found},
            )
        return self

    @property
    def chosen(self) -> Any:
        """The one that is named."""
        return getattr(self, next(iter(self.model_fields_set)))

    def build(self, clock: Clock, substeps: int | None) -> Flow:
        return Streamlines(self.chosen.build(clock), substeps)


class FlowDocument(VelocityDocument):
    """One entry under `flows`: a velocity field, a sum of them, or a deformation."""

    sum: Annotated[list[VelocityDocument], Field(min_length=1)] | None = None
    twist: Annotated[TwistDocument | None, _bare] = None
    taper: Annotated[TaperDocument | None, _bare] = None
    stretch: Annotated[StretchDocument | None, _bare] = None
    shear: Annotated[ShearDocument | None, _bare] = None
    python: PythonDocument | None = None

    def build(self, clock: Clock, substeps: int | None) -> Flow:
        chosen = self.chosen
        if isinstance(chosen, list):
            return Streamlines(Sum(tuple(entry.chosen.build(clock) for entry in chosen)), substeps)
        if isinstance(chosen, PythonDocument):
            return chosen.build(clock)
        if isinstance(chosen, DeformationDocument):
            return chosen.build(clock)  # type: ignore[attr-defined, no-any-return]  # every one of them has it
        return super().build(clock, substeps)
