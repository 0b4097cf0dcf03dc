"""The entries under `flows`: a flow of the catalogue, a sum of velocity fields, or a composition of entries.

A composition holds a list of `flows`. Under `flows` these act one after another, and the composition wraps
the sequence. Under `sum` they are velocity fields that act together, and so is the composition.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, create_model, model_validator

from pipeline.errors import shortened
from pipeline.flow import Flow, Repeated, Reversed, Sequence, Streamlines, Sum, Transform, VelocityField
from pipeline.flow.composed_fields import RegionField, ScaledField, TransformedField, blended, placed, within
from pipeline.flow.composed_maps import Mirror
from pipeline.flow.parameters import Number
from pipeline.frames import FrameRange, FrameRate
from pipeline.shot.clock import SECONDS_PATTERN, Clock
from pipeline.shot.documents.curves import PlaceField, PositiveField, WeightField, number, place
from pipeline.shot.documents.fields import (
    DEGREE,
    ORIGIN,
    Axis,
    Document,
    SchemaKeywords,
    Triple,
    axis,
    optional,
    vector,
)
from pipeline.shot.documents.flow_documents import BARE, entries
from pipeline.shot.documents.regions import RegionDocument
from pipeline.shot.yaml.plain_text import in_yaml
from pipeline.shot.yaml.schema_walk import models_in, needed_names
from pipeline.shot.yaml.validation import bad_value, finding

E = TypeVar("E", bound=Document)

Integrate = Callable[[VelocityField], Streamlines]
"""Turns a velocity field into a flow, by the integrator that the shot names."""


def _positive_duration(value: Any) -> Any:
    length = Clock(FrameRange.of([1]), FrameRate.of(24)).length(value)
    if length is None or not 0 < length < math.inf:
        raise bad_value(
            f"{shortened(value)} is no duration. Write frames, such as 24, or seconds, such as 1s."
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
    length = clock.length(duration)
    assert length is not None, "_positive_duration has refused everything else"
    return length


def _require_dashes(value: Any) -> Any:
    """Refuse flows without dashes, with the list that is meant."""
    names = FlowDocument.model_fields
    if isinstance(value, str) and value in names:
        value = [value]
    elif isinstance(value, dict) and (joined := next((n for n in value if str(n)[1:] in names), None)):
        entry = _entry(joined[1:], value[joined])
        raise bad_value(f"a space is missing after the dash of {joined}. Write {entry}.")
    elif isinstance(value, dict) and (first := next((name for name in value if name in names), None)):
        raise bad_value(f"each flow begins with a dash. Write {_entry(first, value[first])}.")
    for item in value if isinstance(value, list) else ():
        if isinstance(item, str) and item in names:
            needed = dict.fromkeys(needed_names(models_in([names[item].annotation])), "…")
            raise bad_value(f"a flow is a name, a colon and its numbers. Write {_entry(item, needed)}.")
    return value


def _entry(name: str, value: Any) -> str:
    """Return an entry of a list as a shot file has it."""
    return f"- {name}: {in_yaml(value)}" if value else f"- {name}:"


DASHES = BeforeValidator(_require_dashes)
"""Each entry of a list of flows begins with a dash."""


class Composition(Document, Generic[E]):
    """Base of the compositions of one list of flows."""

    flows: Annotated[list[E], Field(min_length=1), DASHES] = Field(
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

    flows: Annotated[list[E], Field(min_length=1, max_length=2), DASHES] = Field(
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
            raise bad_value(
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
                    f"{name} is no velocity field, and only those add up. Make it an entry of flows."
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
