"""Documents made from the dataclasses of flows, which alone define the parameters.

Angles are degrees in the file and radians in the code.
"""

import typing
from dataclasses import MISSING
from typing import Annotated, Any, ClassVar

from pydantic import Field, create_model

from pipeline.flow import Flow, VelocityField
from pipeline.flow.parameters import Parameter, parameter, parameters_of, summary
from pipeline.shot.clock import Clock
from pipeline.shot.documents import curves, fields
from pipeline.shot.documents.fields import Document


class FlowParameters(Document):
    """Base of the documents of flows.

    parameters  those of the flow's dataclass
    own         those that the document adds, such as a file to read
    """

    flow: ClassVar[type[Flow] | type[VelocityField]]
    parameters: ClassVar[tuple[Parameter, ...]]
    own: ClassVar[tuple[Parameter, ...]]

    def build(self, clock: Clock) -> Any:
        """Return the flow; parameters that the file leaves out take the defaults of the code."""
        given = [p for p in self.parameters if p.name in self.model_fields_set]
        return self.flow(
            **{p.name: _value(p, getattr(self, p.name), clock) for p in given}, **self.own_values(clock)
        )

    def own_values(self, clock: Clock) -> dict[str, Any]:
        """Return the arguments of the flow that come from the document's own fields."""
        return {}


def document_of(flow: type, base: type[FlowParameters] = FlowParameters) -> type[FlowParameters]:
    """Return the document of a flow: the fields of `base`, and then the parameters of the dataclass."""
    parameters = parameters_of(flow)
    entries: dict[str, Any] = {p.name: (_kind(p), _field(p)) for p in parameters}
    document = create_model(f"{flow.__name__}Parameters", __base__=base, __doc__=summary(flow), **entries)
    document.flow, document.parameters, document.own = flow, parameters, _own(base)
    return document


def _own(base: type[FlowParameters]) -> tuple[Parameter, ...]:
    kinds = typing.get_type_hints(base, include_extras=True)
    return tuple(
        parameter(
            field.alias or name,
            kinds[name],
            MISSING if field.is_required() else field.get_default(call_default_factory=True),
        )
        for name, field in base.model_fields.items()
    )


def _kind(p: Parameter) -> Any:
    """Return the type of a parameter in a document."""
    if p.bounds:
        return Annotated[p.kind, Field(ge=p.bounds.low, le=p.bounds.high)]
    kinds = {
        "number": curves.PositiveField if p.positive else curves.NumberField,
        "constant": fields.Positive if p.positive else fields.Real,
        "vector": curves.PlaceField,
        "point": fields.Triple,
        "direction": fields.Axis,
    }
    return kinds.get(p.form, p.kind)


def description_of(p: Parameter) -> str:
    """Return one line about a parameter, with its unit in parentheses."""
    return f"{p.doc.text} ({p.doc.unit})" if p.doc.unit else p.doc.text


def _field(p: Parameter) -> Any:
    description = description_of(p)
    return Field(description=description) if p.needed else Field(p.default_in_file, description=description)


def _value(p: Parameter, value: Any, clock: Clock) -> Any:
    """Return a parsed value as the flow takes it."""
    match p.form:
        case "number":
            return curves.number(value, clock, p.doc.factor)
        case "constant":
            return float(value) * p.doc.factor
        case "vector":
            return curves.place(value, clock)
        case "point":
            return fields.vector(value)
        case "direction":
            return fields.axis(value)
        case _:
            return value
