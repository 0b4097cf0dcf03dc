"""The reference of shot files, from their documents: JSON Schemas for editors, and flows for people.

Editors complete and check files by the schemas (draft 2020-12). pydantic writes most of them;
`fields.SchemaKeywords` adds the rules of validators. A schema sees the form of one file. Whether keys lie
within the shot, what a formula means and what a shot extends is for `flowsculpt validate`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from functools import cache
from inspect import cleandoc
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from flowsculpt import VelocityField
from flowsculpt.api.commands import require_one_of
from flowsculpt.api.shots import DOCUMENTS, FLOW_DOCUMENTS, PRESETS, FlowParameters

DIALECT = "https://json-schema.org/draft/2020-12/schema"

BEGIN, END = "<!-- from the code: flowsculpt flows --markdown -->", "<!-- to here -->"
"""The lines before and after the table in the docs."""

Schema = dict[str, Any]


def shot_schema(defaults: Mapping[str, Any] = MappingProxyType({})) -> Schema:
    """Return the schema of shot files beside a `defaults.yaml` that holds `defaults`.

    Names without a default are required unless the shot extends another, which may set them. Editors propose
    the looks and light rigs that `defaults` names.
    """
    schema = schema_of(DOCUMENTS["shot"], "A shot of flowsculpt")
    for registry, name in ((PRESETS["look"], "looks"), (PRESETS["lights"], "rigs")):
        named = defaults.get(name)
        _let_shows_name(schema, list(registry), list(named) if isinstance(named, Mapping) else [])
    needs = {name: _extracted_needs(value, schema["$defs"]) for name, value in schema["properties"].items()}
    alone: Schema = {
        "required": [name for name in schema.pop("required") if name not in defaults],
        "properties": {name: need for name, need in needs.items() if need and name not in defaults},
    }
    if "resample" not in defaults:
        points = {"anyOf": [{"required": [kind]} for kind in ("cloud", "net")]}
        surface = {"required": ["subject"], "properties": {"subject": {"not": points}}}
        alone |= {"if": surface, "then": {"required": ["resample"]}}
    if not {"subject", "subjects"} & set(defaults):
        alone["oneOf"] = [{"required": [name]} for name in ("subject", "subjects")]
    return {**schema, "if": {"not": {"required": ["extends"]}}, "then": alone}


def defaults_schema() -> Schema:
    """Return the schema of `defaults.yaml`: the names of a shot, none of them required."""
    schema = shot_schema()
    del schema["if"], schema["then"]
    return {**schema, "title": "Defaults of flowsculpt's shots"}


def film_schema() -> Schema:
    """Return the schema of film files."""
    return schema_of(DOCUMENTS["edit"], "A film of flowsculpt")


def _let_shows_name(schema: Schema, known: list[str], named: list[str]) -> None:
    """Propose names instead of demanding them: `looks` and `rigs` of a shot or a parent may define others."""
    for inner in list(_mappings(schema)):
        if inner.get("enum") == known:
            inner["anyOf"] = [{"enum": inner.pop("enum") + named}, {"type": "string"}]


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
    for inner in _mappings(definitions):
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
        definition = definitions[_name(flow["$ref"])] if "$ref" in flow else {}
        definition = definition.get("anyOf", [definition])[0]
        if not definition or "required" in definition:
            entry.update(flow)
            del entry["anyOf"]
        entry.setdefault("description", definition.get("description", ""))


def _extracted_needs(value: Schema, definitions: Schema) -> Schema:
    """Remove the needs of the documents that a name can hold, for those may inherit; return them.

    Keys, formulas and sounds keep theirs: they replace others as a whole.
    """
    if isinstance(entries := value.get("additionalProperties"), dict):
        inner = _extracted_needs(entries, definitions)
        return {"additionalProperties": inner} if inner else {}
    forms = [definitions[_name(form["$ref"])] for form in value.get("anyOf", [value]) if "$ref" in form]
    needs = [
        {word: form.pop(word)}
        for form in forms
        for word in ("required", "oneOf")
        if word in form and not {"keys", "formula", "audio"} & set(form.get("required", ()))
    ]
    return {"if": {"type": "object"}, "then": {"anyOf": needs}} if needs else {}


def _name(reference: str) -> str:
    return reference.removeprefix("#/$defs/")


def _with_short_names(schema: Schema) -> Schema:
    """Shorten the names of definitions to the class, without what pydantic adds for type parameters."""
    names: dict[str, str] = {}
    for name in schema.get("$defs", {}):
        short = re.sub(r"Document|Parameters|_?Annotated.*|_+$", "", name).strip("_")
        number = sum(re.fullmatch(rf"{short}\d*", other) is not None for other in names.values())
        names[name] = f"{short}{number + 1 if number else ''}"
    for inner in _mappings(schema):
        if isinstance(inner.get("$ref"), str):
            inner["$ref"] = f"#/$defs/{names[_name(inner['$ref'])]}"
    if names:
        schema["$defs"] = {names[name]: value for name, value in schema["$defs"].items()}
    return schema


def _mappings(value: Any) -> Iterator[Schema]:
    if isinstance(value, dict):
        yield value
        value = list(value.values())
    for inner in value if isinstance(value, list) else ():
        yield from _mappings(inner)


def facts(name: str) -> dict[str, Any]:
    """Describe a flow of the catalogue as JSON-able data, in the units of shot files.

    Raises UsageError for an unknown name.
    """
    require_one_of(name, FLOW_DOCUMENTS, f"{name!r} is not a flow.")
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
    for name in FLOW_DOCUMENTS:
        fact = facts(name)
        parameters = ", ".join(_short(parameter) for parameter in fact["parameters"])
        picture = f"![{name}](pictures/flows/{name}.png)" if fact["kind"] != "function" else ""
        lines.append(f"| {picture} | `{name}` | {fact['description']} | {parameters} |")
    return "\n".join([*lines, END])


def _short(fact: dict[str, Any]) -> str:
    unit = f" {fact['unit']}" if fact["unit"] else ""
    return f"`{fact['name']}` {default_text(fact)}{unit}"
