"""The flows that a shot can name, each with its document, and their list for people and programs."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from pipeline.errors import UsageError, suggestion
from pipeline.flow import VelocityField, catalogue
from pipeline.flow.flow import PythonFlow
from pipeline.flow.parameters import Parameter, shot_name, summary
from pipeline.shot.documents.flow_parameters import FlowParameters, document_of
from pipeline.shot.documents.special_flows import OWN

BARE = BeforeValidator(lambda value: {} if value is None else value)
"""`- enright:` is the same as `- enright: {}`."""

DOCUMENTS: dict[str, type[FlowParameters]] = {
    **{shot_name(flow): document_of(flow) for flow in catalogue.FLOWS},
    **{name: document_of(base.flow, base) for name, base in OWN.items()},
}


def entries(base: type) -> dict[str, Any]:
    """Return optional fields of a document, one for each flow that is a `base`."""
    return {
        name: (Annotated[document | None, BARE], Field(None, validate_default=False))
        for name, document in DOCUMENTS.items()
        if issubclass(document.flow, base)
    }


BEGIN, END = "<!-- from the code: flowsculpt flows --markdown -->", "<!-- to here -->"
"""The lines before and after the table in the docs."""


def facts(name: str) -> dict[str, Any]:
    """Describe a flow of the catalogue as JSON-able data, in the units of shot files.

    Raises UsageError for an unknown name.
    """
    if name not in DOCUMENTS:
        raise UsageError(f"there is no flow {name!r} in the catalogue. {suggestion(name, DOCUMENTS)}")
    document = DOCUMENTS[name]
    return {
        "name": name,
        "kind": _kind(document.flow),
        "description": summary(document.flow),
        "parameters": [_fact(parameter) for parameter in (*document.own, *document.parameters)],
    }


def _kind(flow: type) -> str:
    if issubclass(flow, VelocityField):
        return "velocity"
    return "function" if issubclass(flow, PythonFlow) else "map"


def _fact(parameter: Parameter) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "form": parameter.form,
        "keyed": parameter.form in ("number", "vector"),
        "positive": parameter.positive,
        "choices": list(parameter.choices),
        "unit": parameter.doc.unit,
        "required": parameter.needed,
        "default": parameter.default_in_file,
        "description": parameter.doc.text,
    }


def default_text(fact: dict[str, Any]) -> str:
    """Return the default of a parameter as a shot file writes it, or that it is needed."""
    value = fact["default"]
    if fact["required"]:
        return "needed"
    if value is None or value == {}:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(f'{part:g}' for part in value)}]"
    return value if isinstance(value, str) else f"{value:.6g}"


def markdown() -> str:
    """Return the table of the docs, one line a flow."""
    lines = [BEGIN, "| | in a shot | what it does | parameters |", "|---|---|---|---|"]
    for name in DOCUMENTS:
        fact = facts(name)
        parameters = ", ".join(_short(parameter) for parameter in fact["parameters"])
        picture = f"![{name}](pictures/flows/{name}.png)" if fact["kind"] != "function" else ""
        lines.append(f"| {picture} | `{name}` | {fact['description']} | {parameters} |")
    return "\n".join([*lines, END])


def _short(fact: dict[str, Any]) -> str:
    unit = f" {fact['unit']}" if fact["unit"] else ""
    return f"`{fact['name']}` {default_text(fact)}{unit}"
