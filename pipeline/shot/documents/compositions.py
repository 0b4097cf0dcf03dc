"""Entries under `flows` that are made of other entries, and what they become.

Each holds a list of `flows`. Under `flows` these act one after another, and the composition is of each; under
`sum` they are velocity fields that act together, and so is the composition.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from pipeline.flow import Flow, Frame, Repeated, Reversed, Sequence, Sum, VelocityField
from pipeline.flow.compose import InFrame, Limited, Mirror, Scaled, blended, placed, within
from pipeline.flow.keyframes import Number
from pipeline.frames import FrameRange, FrameRate, shortened
from pipeline.shot.clock import A_LENGTH, Clock
from pipeline.shot.documents.curves import PlaceField, PositiveField, WeightField, number, place
from pipeline.shot.documents.fields import DEGREE, Axis, Document, Told, Triple, axis, vector
from pipeline.shot.documents.regions import HERE, RegionDocument

E = TypeVar("E", bound=Document)


def _lasts(value: Any) -> Any:
    length = Clock(FrameRange.of([1]), FrameRate.of(24)).length(value)
    if length is None or not 0 < length < math.inf:
        what = {"value": shortened(value)}
        raise PydanticCustomError(
            "length_of_time",
            "{value} is no length of time. Write frames, such as 24, or seconds, such as 1s.",
            what,
        )
    return value


LengthOfTime = Annotated[
    Any,
    AfterValidator(_lasts),
    Told(anyOf=[{"type": "number", "exclusiveMinimum": 0}, {"type": "string", "pattern": A_LENGTH}]),
]
"""Frames, or "1s"."""


def seconds(length: Any, clock: Clock) -> float:
    """A parsed length of time in seconds."""
    found = clock.length(length)
    assert found is not None, "its validator refused what is no time"
    return found


class Composition(Document, Generic[E]):
    """What all have: the flows that they are made of."""

    flows: Annotated[list[E], Field(min_length=1)]

    @abstractmethod
    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        """The composition of a flow, which is a sequence."""


class OfFields(Composition[E], Generic[E]):
    """A composition that can stand under `sum` too."""

    @abstractmethod
    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        """The composition of a velocity field."""


class SequenceDocument(Composition[E], Generic[E]):
    """One after another, where one entry is wanted."""

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return flow


class WithinDocument(OfFields[E], Generic[E]):
    region: RegionDocument

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return within(flow, self.region.build(clock))

    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        return Limited(field, self.region.build(clock))


class ElsewhereDocument(OfFields[E], Generic[E]):
    """A flow seen in a frame or a mirror."""

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return placed(flow, self._seen_in(clock))

    def of_field(self, field: VelocityField, clock: Clock) -> VelocityField:
        return InFrame(field, self._seen_in(clock))

    @abstractmethod
    def _seen_in(self, clock: Clock) -> Frame | Mirror: ...


class PlacedDocument(ElsewhereDocument[E], Generic[E]):
    """rotate: degrees about x, then y, then z"""

    translate: PlaceField = HERE
    rotate: PlaceField = HERE
    scale: PositiveField = 1.0

    def _seen_in(self, clock: Clock) -> Frame:
        rotate = place(self.rotate, clock, DEGREE)
        return Frame(place(self.translate, clock), rotate, number(self.scale, clock))


class MirroredDocument(ElsewhereDocument[E], Generic[E]):
    """Across the plane through `centre`."""

    normal: Axis = "x"
    centre: Triple = HERE

    def _seen_in(self, clock: Clock) -> Mirror:
        return Mirror(axis(self.normal), vector(self.centre))


class BlendDocument(Document, Generic[E]):
    """flows: what there is at a weight of 0, and at a weight of 1; one alone comes in from nothing"""

    flows: Annotated[list[E], Field(min_length=1, max_length=2)]
    weight: WeightField

    def of_flows(self, flows: list[Flow], clock: Clock) -> Flow:
        first = flows[0] if len(flows) > 1 else Sequence(())
        return blended(first, flows[-1], number(self.weight, clock))

    def of_fields(self, fields: list[VelocityField], clock: Clock) -> VelocityField:
        weight: Number = number(self.weight, clock)
        rest = [Scaled(field, weight, rest=True) for field in fields[:-1]]
        return Sum((*rest, Scaled(fields[-1], weight)))


class ReversedDocument(Composition[E], Generic[E]):
    """duration: how much of it is undone, frames or seconds; by default as much as the shot is long"""

    duration: LengthOfTime | None = None

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return Reversed(flow, clock.duration if self.duration is None else seconds(self.duration, clock))


class RepeatedDocument(Composition[E], Generic[E]):
    """period: frames or seconds"""

    period: LengthOfTime

    def of_flow(self, flow: Flow, clock: Clock) -> Flow:
        return Repeated(flow, seconds(self.period, clock))
