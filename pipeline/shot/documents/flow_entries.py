"""The entries under `flows`: a flow of the catalogue, a sum of velocity fields, or entries composed."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Self, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema

from flowsculpt.pipeline.errors import quote
from flowsculpt.pipeline.flow import (
    Flow,
    Repeated,
    Reversed,
    Sequence,
    Streamlines,
    Sum,
    Transform,
    VelocityField,
)
from flowsculpt.pipeline.flow.composition import (
    Mirror,
    RegionField,
    ScaledField,
    TransformedField,
    blended,
    placed,
    within,
)
from flowsculpt.pipeline.flow.parameters import Number
from flowsculpt.pipeline.flow.regions import (
    FALLOFF_TYPES,
    BoxRegion,
    CapsuleRegion,
    ClosedSurface,
    CylinderRegion,
    FalloffType,
    HalfSpaceRegion,
    MeshRegion,
    Region,
    SphereRegion,
)
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh.read import read_mesh
from flowsculpt.pipeline.shot.documents.curves import (
    NotNegativeField,
    PlaceField,
    PositiveField,
    WeightField,
    known_seconds,
    number,
    place,
)
from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    ORIGIN,
    Axis,
    Document,
    OneOfSeveral,
    Positive,
    SchemaKeywords,
    Triple,
    axis,
    exactly_one,
    one_of,
    optional,
    require_three,
    vector,
)
from flowsculpt.pipeline.shot.documents.flow_documents import BARE, entries
from flowsculpt.pipeline.shot.motion import SECONDS_PATTERN, Clock
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.pipeline.shot.yaml.messages import models_in, needed_names
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml


class SphereDocument(Document):
    example = "{radius: 1}"

    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    radius: PositiveField = Field(description="its size (units)")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return SphereRegion(place(self.centre, clock), number(self.radius, clock), **falloff)


class BoxDocument(Document):
    example = "{size: [1, 1, 1]}"

    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    size: Annotated[list[Positive], BeforeValidator(require_three), Field(min_length=3, max_length=3)] = (
        Field(description="its sides along x, y and z (units)")
    )

    def build(self, clock: Clock, **falloff: Any) -> Region:
        x, y, z = map(float, self.size)
        return BoxRegion(place(self.centre, clock), (x, y, z), **falloff)


class HalfSpaceDocument(Document):
    centre: PlaceField = Field(ORIGIN, description="a point of its plane (units)")
    normal: Axis = Field("y", description="points up from the plane, and out: x, y, z or a vector")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return HalfSpaceRegion(place(self.centre, clock), axis(self.normal), **falloff)


class CapsuleDocument(Document):
    """A segment of a line with a radius."""

    region: ClassVar[type[CapsuleRegion | CylinderRegion]] = CapsuleRegion

    axis: Axis = Field("y", description="direction of its segment: x, y, z or a vector")
    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    length: PositiveField = Field(description="of its segment (units)")
    radius: PositiveField = Field(description="around the segment (units)")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return self.region(
            axis=axis(self.axis),
            centre=place(self.centre, clock),
            length=number(self.length, clock),
            radius=number(self.radius, clock),
            **falloff,
        )


class CylinderDocument(CapsuleDocument):
    region = CylinderRegion


class MeshDocument(Document):
    """The inside of the closed surface in a file; `mesh: stone.obj` is `mesh: {file: stone.obj}`."""

    file: str = Field(description="an OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD beside the shot file")
    centre: PlaceField = Field(ORIGIN, description="position of its origin (units)")
    scale: PositiveField = Field(1.0, description="factor on its coordinates")

    _surface: ClosedSurface = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": "string"}]}

    @model_validator(mode="after")
    def _is_closed(self, info: ValidationInfo) -> Self:
        path = ParseContext.of(info).mesh(self.file)
        self._surface = ClosedSurface.of(read_mesh(path), str(path))
        return self

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return MeshRegion(self._surface, place(self.centre, clock), number(self.scale, clock), **falloff)


class RegionDocument(OneOfSeveral):
    """A shape by its name, and its falloff."""

    example = "{sphere: {radius: 1}}"
    noun, several = "a region", ("sphere", "box", "half_space", "capsule", "cylinder", "mesh")

    model_config = exactly_one(*several)
    sphere: SphereDocument | None = optional("all within a radius of a point")
    box: BoxDocument | None = optional("all within sides along x, y and z")
    half_space: HalfSpaceDocument | None = optional("all below a plane")
    capsule: CapsuleDocument | None = optional("all within a radius of a segment of a line; round ends")
    cylinder: CylinderDocument | None = optional("a capsule with flat ends")
    mesh: MeshDocument | None = optional("the inside of the closed surface in a file")
    falloff: NotNegativeField = Field(
        0.0, description="distance outside over which the weight falls to 0 (units)"
    )
    falloff_type: Annotated[str, one_of(FALLOFF_TYPES, "falloff type")] = Field(
        "smooth", description="profile of the falloff"
    )
    invert: bool = Field(False, description="the outside instead of the inside")

    def build(self, clock: Clock) -> Region:
        shape = getattr(self, self.named[0])
        falloff_type: FalloffType = self.falloff_type  # type: ignore[assignment]  # as its validator says
        return shape.build(
            clock, falloff=number(self.falloff, clock), falloff_type=falloff_type, invert=self.invert
        )


E = TypeVar("E", bound=Document)

Integrate = Callable[[VelocityField], Streamlines]
"""Turns a velocity field into a flow, by the integrator that the shot names."""


def _positive_duration(value: Any) -> Any:
    length = Clock(FrameRange.of([1]), FrameRate.of(24)).length(value)
    if length is None or not 0 < length < math.inf:
        raise ValueError(
            f"{quote(value)} is not a duration. Write frames, such as 24, or seconds, such as 1s."
        )
    return value


Duration = Annotated[
    Any,
    AfterValidator(_positive_duration),
    SchemaKeywords(
        anyOf=[{"type": "number", "exclusiveMinimum": 0}, {"type": "string", "pattern": SECONDS_PATTERN}]
    ),
]
"""Frames as a number, or seconds as "1s"."""


def seconds(duration: Any, clock: Clock) -> float:
    """Return a parsed duration in seconds."""
    return known_seconds(clock.length(duration))


def _require_dashes(value: Any) -> Any:
    """Refuse flows without dashes, with the list that is meant."""
    names = FlowDocument.model_fields
    if isinstance(value, str) and value in names:
        value = [value]
    elif isinstance(value, dict) and (joined := next((n for n in value if str(n)[1:] in names), None)):
        entry = _entry(joined[1:], value[joined])
        raise ValueError(f"a space is missing after the dash of {joined}. Write {entry}.")
    elif isinstance(value, dict) and (first := next((name for name in value if name in names), None)):
        raise ValueError(f"each flow begins with a dash. Write {_entry(first, value[first])}.")
    for item in value if isinstance(value, list) else ():
        if isinstance(item, str) and item in names:
            needed = dict.fromkeys(needed_names(models_in([names[item].annotation])), "…")
            raise ValueError(f"a flow is a name, a colon and its numbers. Write {_entry(item, needed)}.")
    return value


def _entry(name: str, value: Any) -> str:
    """Return an entry of a list as a shot file has it."""
    return f"- {name}: {in_yaml(value)}" if value else f"- {name}:"


DASHES = BeforeValidator(_require_dashes)
"""Each entry of a list of flows begins with a dash."""


def _require_independent(entry: Any) -> Any:
    """Refuse a flow that depends on its subject: only those of a list of flows know theirs."""
    flow = getattr(entry.chosen, "flow", Flow)
    if issubclass(flow, Flow) and flow.of_subject is not Flow.of_subject:
        fact = f"{next(iter(entry.model_fields_set))} acts on a whole subject, so no entry can contain it"
        raise finding(f"{fact}. Make it an entry of flows.")
    return entry


_Part = Annotated[E, AfterValidator(_require_independent)]


class Composition(Document, Generic[E]):
    """Base of the compositions of one list of flows."""

    flows: Annotated[list[_Part[E]], Field(min_length=1), DASHES] = Field(
        description="its flows, which act one after another"
    )

    @abstractmethod
    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        """Return the composition of a flow, which is a sequence."""


class FieldComposition(Composition[E], Generic[E]):
    """Base of the compositions that can stand under `sum` too."""

    @abstractmethod
    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        """Return the composition of a velocity field."""


class SequenceDocument(Composition[E], Generic[E]):
    """Several flows, one after another, as one entry."""

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return flow


class WithinDocument(FieldComposition[E], Generic[E]):
    region: RegionDocument = Field(description="the region in which they act")

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return within(flow, self.region.build(clock))

    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        return RegionField(field, self.region.build(clock))


class TransformedDocument(FieldComposition[E], Generic[E]):
    """Base of the compositions that move a flow into a frame or a mirror."""

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return placed(flow, self._transform(clock))

    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        return TransformedField(field, self._transform(clock))

    @abstractmethod
    def _transform(self, clock: Clock) -> Transform | Mirror: ...


class PlacedDocument(TransformedDocument[E], Generic[E]):
    """Flows in a frame of reference that is scaled, then turned, then moved."""

    translate: PlaceField = Field(ORIGIN, description="the new place of the origin (units)")
    rotate: PlaceField = Field(ORIGIN, description="about x, then y, then z (degrees)")
    scale: PositiveField = Field(1.0, description="factor on distances and speeds")

    def _transform(self, clock: Clock) -> Transform:
        rotate = place(self.rotate, clock, DEGREE)
        return Transform(place(self.translate, clock), rotate, number(self.scale, clock))


class MirroredDocument(TransformedDocument[E], Generic[E]):
    """Flows mirrored across the plane through `centre`."""

    normal: Axis = Field("x", description="of the mirror: x, y, z or a vector")
    centre: Triple = Field(ORIGIN, description="a point of the mirror (units)")

    def _transform(self, clock: Clock) -> Mirror:
        return Mirror(axis(self.normal), vector(self.centre))


class BlendDocument(Document, Generic[E]):
    """A blend from one flow, or from rest, to another."""

    flows: Annotated[list[_Part[E]], Field(min_length=1, max_length=2), DASHES] = Field(
        description="one that starts from rest, or two: from the first to the second"
    )
    weight: WeightField = Field(description="of the last, from 0 to 1")

    def of_flows(self, flows: list[Flow], clock: Clock) -> Flow:
        first = flows[0] if len(flows) > 1 else Sequence(())
        return blended(first, flows[-1], number(self.weight, clock))

    def of_fields(self, fields: list[VelocityField], clock: Clock) -> VelocityField:
        weight: Number = number(self.weight, clock)
        rest = [ScaledField(field, weight, rest=True) for field in fields[:-1]]
        return Sum((*rest, ScaledField(fields[-1], weight)))


class ReversedDocument(Composition[E], Generic[E]):
    duration: Duration | None = optional(
        "how much is undone: frames, or seconds as 1s; by default the whole shot"
    )

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return Reversed(flow, clock.duration if self.duration is None else seconds(self.duration, clock))


class RepeatedDocument(Composition[E], Generic[E]):
    period: Duration = Field(description="frames, or seconds as 1s")

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return Repeated(flow, seconds(self.period, clock))


class Entry(Document):
    """Exactly one flow by its name."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    @model_validator(mode="after")
    def _names_one(self) -> Entry:
        named = sorted(self.model_fields_set)
        if len(named) != 1:
            raise ValueError(
                "a flow is one name and its parameters, and this entry has "
                f"{' and '.join(named) or 'nothing'}. Start each flow with a dash of its own."
            )
        return self

    @property
    def chosen(self) -> Any:
        """The document of the flow that the entry names."""
        return getattr(self, next(iter(self.model_fields_set)))


if TYPE_CHECKING:

    class Velocities(Entry): ...

    class Flows(Velocities): ...
else:
    Velocities = create_model("Velocities", __base__=Entry, **entries(VelocityField))
    Flows = create_model("Flows", __base__=Velocities, **entries(Flow))


LISTED = BeforeValidator(lambda value: [] if value is None else value)
"""`- sum:` is the same as `- sum: []`."""


class VelocityDocument(Velocities):
    """One entry under `sum`: a velocity field."""

    within: Annotated[WithinDocument[VelocityDocument] | None, BARE] = optional("flows in a region")
    placed: Annotated[PlacedDocument[VelocityDocument] | None, BARE] = optional(
        "flows scaled, then turned, then moved"
    )
    mirrored: Annotated[MirroredDocument[VelocityDocument] | None, BARE] = optional("flows across a plane")
    blend: Annotated[BlendDocument[VelocityDocument] | None, BARE] = optional("from one, or rest, to another")

    @model_validator(mode="before")
    @classmethod
    def _is_a_field(cls, value: Any) -> Any:
        for name in value if isinstance(value, dict) else ():
            if name in FlowDocument.model_fields and name not in cls.model_fields:
                raise finding(
                    f"{name} is not a velocity field, and only those add up. Make it an entry of flows."
                )
        return value

    def build(self, clock: Clock) -> VelocityField:
        chosen = self.chosen
        if isinstance(chosen, FieldComposition):
            return chosen.of_field(Sum(tuple(entry.build(clock) for entry in chosen.flows)), clock)
        if isinstance(chosen, BlendDocument):
            return chosen.of_fields([entry.build(clock) for entry in chosen.flows], clock)
        return chosen.build(clock)


class FlowDocument(Flows):
    """One entry under `flows`: a velocity field, a sum of them, a map, or a composition of such entries."""

    sum: Annotated[list[VelocityDocument] | None, Field(min_length=1), LISTED, DASHES] = optional(
        "velocity fields that act together"
    )
    sequence: Annotated[SequenceDocument[FlowDocument] | None, BARE] = optional(
        "flows in order, as one entry"
    )
    within: Annotated[WithinDocument[FlowDocument] | None, BARE] = optional("flows in a region")
    placed: Annotated[PlacedDocument[FlowDocument] | None, BARE] = optional(
        "flows scaled, then turned, then moved"
    )
    mirrored: Annotated[MirroredDocument[FlowDocument] | None, BARE] = optional("flows across a plane")
    blend: Annotated[BlendDocument[FlowDocument] | None, BARE] = optional("from one, or rest, to another")
    reversed: Annotated[ReversedDocument[FlowDocument] | None, BARE] = optional("flows backwards")
    repeated: Annotated[RepeatedDocument[FlowDocument] | None, BARE] = optional(
        "flows from 0 to the end of the period, again and again"
    )

    def build(self, clock: Clock, integrate: Integrate) -> Flow:
        """Return the flow; `integrate` turns a velocity field into one."""
        chosen = self.chosen
        if isinstance(chosen, list):
            return integrate(Sum(tuple(entry.build(clock) for entry in chosen)))
        if isinstance(chosen, Composition | BlendDocument):
            flows = [entry.build(clock, integrate) for entry in chosen.flows]
            if isinstance(chosen, BlendDocument):
                return chosen.of_flows(flows, clock)
            return chosen.of_flow(Sequence(tuple(flows)), clock)
        flow: Flow | VelocityField = chosen.build(clock)
        return integrate(flow) if isinstance(flow, VelocityField) else flow
