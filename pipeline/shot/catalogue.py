"""The flows of the catalogue as shot files write them: documents made from the dataclasses.

Angles are degrees in the file and radians from here on.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, create_model

from pipeline.flow import Flow, VelocityField, catalogue
from pipeline.flow.parameters import Parameter, parameters_of, shot_name, summary
from pipeline.shot import fields
from pipeline.shot.clock import Clock
from pipeline.shot.fields import Document


class CatalogueDocument(Document):
    """What a flow takes in a shot file."""

    flow: ClassVar[type[Flow] | type[VelocityField]]
    parameters: ClassVar[tuple[Parameter, ...]]

    def build(self, clock: Clock) -> Any:
        """The flow; what the file does not say has the default of the code."""
        said = [p for p in self.parameters if p.name in self.model_fields_set]
        return self.flow(**{p.name: _value(p, getattr(self, p.name), clock) for p in said})


def _document(flow: type) -> type[CatalogueDocument]:
    parameters = parameters_of(flow)
    entries: dict[str, Any] = {p.name: (_kind(p), _field(p)) for p in parameters}
    made = create_model(
        f"{flow.__name__}Document", __base__=CatalogueDocument, __doc__=summary(flow), **entries
    )
    made.flow, made.parameters = flow, parameters
    return made


def _kind(p: Parameter) -> Any:
    """The type of a parameter in a document."""
    kinds = {
        "number": fields.PositiveField if p.positive else fields.NumberField,
        "constant": fields.Positive if p.positive else fields.Real,
        "place": fields.PlaceField,
        "point": fields.Triple,
        "direction": fields.Axis,
    }
    return kinds.get(p.form, p.kind)


def _field(p: Parameter) -> Any:
    told = f"{p.sense.text} ({p.sense.unit})" if p.sense.unit else p.sense.text
    return Field(description=told) if p.needed else Field(p.default_in_file, description=told)


def _value(p: Parameter, value: Any, clock: Clock) -> Any:
    """A parsed value as the flow takes it."""
    match p.form:
        case "number":
            return fields.number(value, clock, p.sense.factor)
        case "constant":
            return float(value) * p.sense.factor
        case "place":
            return fields.place(value, clock)
        case "point":
            return fields.vector(value)
        case "direction":
            return fields.axis(value)
        case _:
            return value


BARE = BeforeValidator(lambda value: {} if value is None else value)
"""`- enright:` is the same as `- enright: {}`."""

DOCUMENTS = {shot_name(flow): _document(flow) for flow in catalogue.FLOWS}


def entries(base: type) -> dict[str, Any]:
    """Fields of a document, one for each flow of the catalogue that is a `base`, all of them optional."""
    return {
        name: (Annotated[document | None, BARE], Field(None, validate_default=False))
        for name, document in DOCUMENTS.items()
        if issubclass(document.flow, base)
    }
