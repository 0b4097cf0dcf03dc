"""Documents made from the dataclasses of flows, which alone define the parameters.

Angles are degrees in the file and radians in the code.
"""

import typing
from dataclasses import MISSING
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, create_model

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow import Flow, VelocityField, catalogue
from flowsculpt.pipeline.flow.flow import PluginMap
from flowsculpt.pipeline.flow.parameters import Parameter, parameter, parameters_of, shot_name, summary
from flowsculpt.pipeline.flow.velocity import PluginField
from flowsculpt.pipeline.plugin import Plugin, plugins
from flowsculpt.pipeline.plugin_contracts import require_class
from flowsculpt.pipeline.shot.documents import curves
from flowsculpt.pipeline.shot.documents.field_types import (
    Axis,
    Document,
    Positive,
    Real,
    Triple,
    axis,
    vector,
)
from flowsculpt.pipeline.shot.motion import Clock


class FlowParameters(Document):
    """Base of the documents of flows.

    parameters  those of the flow's dataclass
    own         those that the document adds, such as a file to read
    origin      of a plug-in's flow, the plug-in, its version and the flow's name
    """

    flow: ClassVar[type[Flow] | type[VelocityField]]
    origin: ClassVar[tuple[str, str, str] | None] = None
    parameters: ClassVar[tuple[Parameter, ...]]
    own: ClassVar[tuple[Parameter, ...]]

    def build(self, clock: Clock) -> Any:
        """Return the flow; parameters that the file leaves out take the defaults of the code."""
        given = [p for p in self.parameters if p.name in self.model_fields_set]
        flow = self.flow(
            **{p.name: _value(p, getattr(self, p.name), clock) for p in given}, **self.own_values(clock)
        )
        if self.origin is None:
            return flow
        return PluginMap(flow, self.origin) if isinstance(flow, Flow) else PluginField(flow, self.origin)

    def variable_field(self, variable: str, file: str | None, clock: Clock) -> tuple[VelocityField, str, str]:
        """Return a variable of its data, or of another file: a field, what readers call it, and its unit.

        The field is (value · known, known, 1) within the data. Raises UsageError where there is none.
        """
        raise UsageError(f"{shot_name(self.flow)} has no data, and so no variable {variable}. Take sampled.")

    def own_values(self, clock: Clock) -> dict[str, Any]:
        """Return the arguments of the flow that come from the document's own fields."""
        return {}


def document_of(flow: type, base: type[FlowParameters] = FlowParameters) -> type[FlowParameters]:
    """Return the document of a flow: the fields of `base`, and then the parameters of the dataclass.

    A field of `base` of a parameter's name says how shot files write that parameter.
    """
    parameters = parameters_of(flow)
    added = [p for p in parameters if p.name not in base.model_fields]
    entries: dict[str, Any] = {p.name: (_kind(p), _field(p)) for p in added}
    document = create_model(f"{flow.__name__}Parameters", __base__=base, __doc__=summary(flow), **entries)
    own = tuple(p for p in _own(base) if p.name not in {parameter.name for parameter in parameters})
    document.flow, document.parameters, document.own = flow, parameters, own
    return document


def _document_of_plugin(plugin: Plugin, name: str, flow: Any) -> type[FlowParameters]:
    """Return the document of a plug-in's flow, or of its base document. Raises ContractError."""
    base = FlowParameters
    if isinstance(flow, type) and issubclass(flow, FlowParameters):
        base, flow = flow, flow.flow
    require_class(flow, VelocityField, Flow)
    document = document_of(flow, base)
    if plugin.version:
        document.origin = (plugin.name, plugin.version, name)
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
    if p.doc.bounds:
        return Annotated[p.kind, Field(ge=p.doc.bounds[0], le=p.doc.bounds[1])]
    kinds = {
        "number": curves.PositiveField if p.positive else curves.NumberField,
        "constant": Positive if p.positive else Real,
        "vector": curves.PlaceField,
        "point": Triple,
        "direction": Axis,
    }
    return kinds.get(p.form, p.kind)


def _field(p: Parameter) -> Any:
    about = p.description
    return Field(description=about) if p.needed else Field(p.default_in_file, description=about)


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
            return vector(value)
        case "direction":
            return axis(value)
        case _:
            return value


FLOW_DOCUMENTS: dict[str, type[FlowParameters]] = {
    **{shot_name(flow): document_of(flow) for flow in catalogue.FLOWS},
    **plugins().parts("flows", _document_of_plugin),
}
"""The flows that a shot can name, in the order of the docs; those of plug-ins last."""

BARE = BeforeValidator(lambda value: {} if value is None else value)
"""`- enright:` is the same as `- enright: {}`."""


def entries(base: type) -> dict[str, Any]:
    """Return optional fields of a document, one for each flow that is a `base`."""
    return {
        name: (Annotated[document | None, BARE], Field(None, validate_default=False))
        for name, document in FLOW_DOCUMENTS.items()
        if issubclass(document.flow, base)
    }
