"""The reference of shot files, from their documents: JSON Schemas for editors, and flows for people.

Editors complete and check files by the schemas (draft 2020-12). A schema sees the form of one file. Whether
keys lie within the shot, what a formula means and what a shot extends is for `flowsculpt validate`.
`document_schemas` finds them, which takes a second; they are kept for the same code and plug-ins.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from flowsculpt.api.commands import require_one_of
from flowsculpt.pipeline.plugins.authoring.reference import Schema, definition_name, kept, mappings

BEGIN, END = "<!-- from the code: flowsculpt flows --markdown -->", "<!-- to here -->"
"""The lines before and after the table in the docs."""


def schema_of_document(kind: str, title: str) -> Schema:
    """Return the schema of a kind of files, `shot` or `edit`, with what it needs where it stands."""

    def found() -> Schema:
        from flowsculpt.api.shots import DOCUMENTS
        from flowsculpt.pipeline.plugins.authoring.document_schemas import schema_of

        return schema_of(DOCUMENTS[kind], title)

    return kept(f"schema of {kind}", found)


@cache
def flows() -> dict[str, dict[str, Any]]:
    """Return the flows of the catalogue by name, described as JSON-able data in the units of shot files."""

    def found() -> dict[str, dict[str, Any]]:
        from flowsculpt.pipeline.plugins.authoring.document_schemas import flow_facts

        return flow_facts()

    return kept("flows", found)


@cache
def preset_names() -> dict[str, list[str]]:
    """Return the names of presets by kind, as `look` and `set`; measures by `solid NAME`."""

    def found() -> dict[str, list[str]]:
        from flowsculpt.pipeline.plugins.authoring import document_schemas

        return document_schemas.preset_names()

    return kept("names", found)


def shot_schema(defaults: Mapping[str, Any] = MappingProxyType({})) -> Schema:
    """Return the schema of shot files beside a `defaults.yaml` that holds `defaults`.

    Names without a default are required unless the shot extends another, which may set them. Editors propose
    the looks and light rigs that `defaults` names.
    """
    schema = schema_of_document("shot", "A shot of flowsculpt")
    for kind, name in (("look", "looks"), ("lights", "rigs")):
        named = defaults.get(name)
        _let_shows_name(schema, preset_names()[kind], list(named) if isinstance(named, Mapping) else [])
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
    return schema_of_document("edit", "A film of flowsculpt")


def _let_shows_name(schema: Schema, known: list[str], named: list[str]) -> None:
    """Propose names instead of demanding them: `looks` and `rigs` of a shot or a parent may define others."""
    for inner in list(mappings(schema)):
        if inner.get("enum") == known:
            inner["anyOf"] = [{"enum": inner.pop("enum") + named}, {"type": "string"}]


def _extracted_needs(value: Schema, definitions: Schema) -> Schema:
    """Remove the needs of the documents that a name can hold, for those may inherit; return them.

    Keys, formulas and sounds keep theirs: they replace others as a whole.
    """
    if isinstance(entries := value.get("additionalProperties"), dict):
        inner = _extracted_needs(entries, definitions)
        return {"additionalProperties": inner} if inner else {}
    forms = [
        definitions[definition_name(form["$ref"])] for form in value.get("anyOf", [value]) if "$ref" in form
    ]
    needs = [
        {word: form.pop(word)}
        for form in forms
        for word in ("required", "oneOf")
        if word in form and not {"keys", "formula", "audio"} & set(form.get("required", ()))
    ]
    return {"if": {"type": "object"}, "then": {"anyOf": needs}} if needs else {}


def facts(name: str) -> dict[str, Any]:
    """Return a flow of the catalogue as `flows` has it. Raises UsageError for an unknown name."""
    require_one_of(name, flows(), f"{name!r} is not a flow.")
    return flows()[name]


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
    for name, fact in flows().items():
        parameters = ", ".join(_short(parameter) for parameter in fact["parameters"])
        picture = f"![{name}](pictures/flows/{name}.png)" if fact["kind"] != "function" else ""
        lines.append(f"| {picture} | `{name}` | {fact['description']} | {parameters} |")
    return "\n".join([*lines, END])


def _short(fact: dict[str, Any]) -> str:
    unit = f" {fact['unit']}" if fact["unit"] else ""
    return f"`{fact['name']}` {default_text(fact)}{unit}"
