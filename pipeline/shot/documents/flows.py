"""The entries under `flows`: a flow of the catalogue, a sum of velocities, or a composition of entries."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, create_model, model_validator
from pydantic_core import PydanticCustomError

from pipeline.flow import Flow, Sequence, Streamlines, Sum, VelocityField
from pipeline.shot.clock import Clock
from pipeline.shot.documents.catalogue import BARE, entries
from pipeline.shot.documents.compositions import (
    BlendDocument,
    Composition,
    MirroredDocument,
    OfFields,
    PlacedDocument,
    RepeatedDocument,
    ReversedDocument,
    SequenceDocument,
    WithinDocument,
)
from pipeline.shot.documents.fields import Document
from pipeline.shot.yaml.parse_context import finding

Follow = Callable[[VelocityField], Streamlines]


class Entry(Document):
    """Exactly one flow by its name."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    @model_validator(mode="after")
    def _names_one(self) -> Entry:
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

    within: Annotated[WithinDocument[VelocityDocument] | None, BARE] = None
    placed: Annotated[PlacedDocument[VelocityDocument] | None, BARE] = None
    mirrored: Annotated[MirroredDocument[VelocityDocument] | None, BARE] = None
    blend: Annotated[BlendDocument[VelocityDocument] | None, BARE] = None

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
        if isinstance(chosen, OfFields):
            return chosen.of_field(Sum(tuple(entry.build(clock) for entry in chosen.flows)), clock)
        if isinstance(chosen, BlendDocument):
            return chosen.of_fields([entry.build(clock) for entry in chosen.flows], clock)
        field: VelocityField = chosen.build(clock)
        return field


class FlowDocument(Flows):
    """One entry under `flows`: a velocity field, a sum of them, a map, or what is made of such entries."""

    sum: Annotated[list[VelocityDocument] | None, Field(min_length=1), LISTED] = None
    sequence: Annotated[SequenceDocument[FlowDocument] | None, BARE] = None
    within: Annotated[WithinDocument[FlowDocument] | None, BARE] = None
    placed: Annotated[PlacedDocument[FlowDocument] | None, BARE] = None
    mirrored: Annotated[MirroredDocument[FlowDocument] | None, BARE] = None
    blend: Annotated[BlendDocument[FlowDocument] | None, BARE] = None
    reversed: Annotated[ReversedDocument[FlowDocument] | None, BARE] = None
    repeated: Annotated[RepeatedDocument[FlowDocument] | None, BARE] = None

    def build(self, clock: Clock, follow: Follow) -> Flow:
        """`follow` is how the shot integrates velocities."""
        chosen = self.chosen
        if isinstance(chosen, list):
            return follow(Sum(tuple(entry.build(clock) for entry in chosen)))
        if isinstance(chosen, Composition | BlendDocument):
            flows = [entry.build(clock, follow) for entry in chosen.flows]
            if isinstance(chosen, BlendDocument):
                return chosen.of_flows(flows, clock)
            return chosen.of_flow(Sequence(tuple(flows)), clock)
        flow: Flow | VelocityField = chosen.build(clock)
        return follow(flow) if isinstance(flow, VelocityField) else flow
