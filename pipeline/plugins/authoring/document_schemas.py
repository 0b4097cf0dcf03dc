"""The schemas and flows of shot files, found from their documents: see `shot_schemas`, which keeps them.

pydantic writes most of the schemas; `fields.SchemaKeywords` adds the rules of validators.
"""

from __future__ import annotations

import re
from copy import deepcopy
from functools import cache
from inspect import cleandoc
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from flowsculpt import VelocityField
from flowsculpt.api.shots import FLOW_DOCUMENTS, PRESETS, FlowParameters, Solid
from flowsculpt.pipeline.plugins.authoring.reference import Schema, definition_name, mappings

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def flow_facts() -> dict[str, dict[str, Any]]:
    """Describe the flows of the catalogue by name as JSON-able data, in the units of shot files."""
    return {name: _flow_fact(name) for name in FLOW_DOCUMENTS}


def preset_names() -> dict[str, list[str]]:
    """Return the names of looks, light rigs, stages and sets, and of the solids with their measures."""
    solids = {f"solid {name}": list(kind.measures) for name, kind in Solid.KINDS.items()}
    return {**{kind: list(known) for kind, known in PRESETS.items()}, **solids, "solids": list(Solid.KINDS)}


def _flow_fact(name: str) -> dict[str, Any]:
    document = FLOW_DOCUMENTS[name]
    kind = "function" if name == "python" else "map"
    return {
        "name": name,
        "kind": "velocity" if issubclass(document.flow, VelocityField) else kind,
        "description": cleandoc(document.flow.__doc__ or "").partition("\n")[0],
        "parameters": [_fact(parameter) for parameter in (*document.own, *document.parameters)],
    }


def _fact(parameter: Any) -> dict[str, Any]:
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


class _Generator(GenerateJsonSchema):
    """pydantic's generator, without titles and class docstrings."""

    schema_dialect = DIALECT

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        """Return a union without its tags: the forms differ visibly, so any that fits will do."""
        forms = super().tagged_union_schema(schema)["oneOf"]
        different = [form for i, form in enumerate(forms) if form not in forms[:i]]
        return different[0] if len(different) == 1 else {"anyOf": different}

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        result, document = super().model_schema(schema), schema["cls"]
        del result["title"]
        if not issubclass(document, FlowParameters):
            result.pop("description", None)  # a docstring is for readers of the code
        own = {p.name: p for p in document.own} if issubclass(document, FlowParameters) else {}
        for name, value in result["properties"].items():
            value.pop("title", None)
            if value.get("default", ...) is None:
                del value["default"]
            if name in own:
                value["description"] = own[name].description
        return result


def schema_of(document: type[BaseModel], title: str) -> Schema:
    """Return the schema of a document, with what it needs where it stands, whatever a shot may inherit."""
    return {"$schema": DIALECT, "title": title, **deepcopy(_pydantic_schema(document))}


@cache
def _pydantic_schema(document: type[BaseModel]) -> Schema:
    schema = document.model_json_schema(schema_generator=_Generator)
    definitions = schema.get("$defs", {})
    for entry in ("FlowDocument", "VelocityDocument"):
        if entry in definitions:
            _describe_flows(definitions[entry]["properties"], definitions)
    for inner in mappings(definitions):
        _use_standard_bounds(inner)
    return _with_short_names(schema)


_BOUNDS = {
    "ge": ("minimum", max),
    "gt": ("exclusiveMinimum", max),
    "le": ("maximum", min),
    "lt": ("exclusiveMaximum", min),
}


def _use_standard_bounds(schema: Schema) -> None:
    """Rename bounds that pydantic leaves under its own names where a number has several; keep the tighter."""
    for word, (standard, tighter) in _BOUNDS.items():
        bound = schema.get(word)
        if isinstance(bound, int | float):
            del schema[word]
            schema[standard] = tighter(bound, schema.get(standard, bound))


def _describe_flows(properties: Schema, definitions: Schema) -> None:
    """Copy the summary of each flow to its entry; a flow without needs may be a name alone (`- enright:`)."""
    for entry in properties.values():
        flow = entry["anyOf"][0]
        definition = definitions[definition_name(flow["$ref"])] if "$ref" in flow else {}
        definition = definition.get("anyOf", [definition])[0]
        if not definition or "required" in definition:
            entry.update(flow)
            del entry["anyOf"]
        entry.setdefault("description", definition.get("description", ""))


def _with_short_names(schema: Schema) -> Schema:
    """Shorten the names of definitions to the class, without what pydantic adds for type parameters."""
    names: dict[str, str] = {}
    for name in schema.get("$defs", {}):
        short = re.sub(r"Document|Parameters|_?Annotated.*|_+$", "", name).strip("_")
        number = sum(re.fullmatch(rf"{short}\d*", other) is not None for other in names.values())
        names[name] = f"{short}{number + 1 if number else ''}"
    for inner in mappings(schema):
        if isinstance(inner.get("$ref"), str):
            inner["$ref"] = f"#/$defs/{names[definition_name(inner['$ref'])]}"
    if names:
        schema["$defs"] = {names[name]: value for name, value in schema["$defs"].items()}
    return schema
