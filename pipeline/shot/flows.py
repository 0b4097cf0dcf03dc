"""The entries under `flows`: a flow of the catalogue, or a sum of velocities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model, model_validator
from pydantic_core import PydanticCustomError

from pipeline.flow import Flow, Streamlines, Sum, VelocityField
from pipeline.shot.catalogue import BARE, entries
from pipeline.shot.clock import Clock
from pipeline.shot.field_documents import (
    AttractionDocument,
    CurlNoiseDocument,
    Formulas,
    PythonDocument,
    SampledDocument,
    WindDocument,
)
from pipeline.shot.fields import Document


class Entry(Document):
    """Exactly one flow by its name."""

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


class OwnFields(Entry):
    """Velocity fields of the shot's own making."""

    formula: Formulas = None
    curl_noise: Annotated[CurlNoiseDocument | None, BARE] = None
    attraction: AttractionDocument | None = None
    wind: WindDocument | None = None
    sampled: SampledDocument | None = None


class VelocityDocument(Velocities, OwnFields):
    """One entry under `sum`: a velocity field."""

    def build(self, clock: Clock) -> VelocityField:
        field: VelocityField = self.chosen.build(clock)
        return field


class FlowDocument(Flows, OwnFields):
    """One entry under `flows`: a velocity field, a sum of them, a map, or a function in Python."""

    python: PythonDocument | None = None
    sum: Annotated[list[VelocityDocument], Field(min_length=1)] | None = None

    def build(self, clock: Clock, substeps: int | None) -> Flow:
        chosen = self.chosen
        if isinstance(chosen, list):
            return Streamlines(Sum(tuple(entry.build(clock) for entry in chosen)), substeps)
        flow: Flow | VelocityField = chosen.build(clock)
        return Streamlines(flow, substeps) if isinstance(flow, VelocityField) else flow
