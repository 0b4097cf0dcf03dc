"""JSON Schemas (draft 2020-12) of shot and film files, made from their documents, for editors to complete
and check by.

pydantic writes most of it. What it cannot see is marked where it is checked (`fields.Told`), and what names
mean is said by the flows and by `hints`. A schema sees one file and no further than its form: whether keys
lie within the shot, what a formula means and what a shot extends is told by `flowsculpt validate`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from pipeline.shot.documents.flow_parameters import FlowParameters
from pipeline.shot.documents.flows import FlowDocument, VelocityDocument
from pipeline.shot.documents.shot import FilmDocument, ShotDocument
from pipeline.shot.hints import hint, in_a_line

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = dict[str, Any]


def shot_schema(said: Collection[str] = ()) -> Schema:
    """Of a shot file, beside a `defaults.yaml` that says the names in `said`.

    What has no default must be there, unless the shot extends another, which may say it.
    """
    schema = _made(ShotDocument, "A shot of flowsculpt")
    needs = {name: _moved_needs(value, schema["$defs"]) for name, value in schema["properties"].items()}
    alone = {
        "required": [name for name in schema.pop("required") if name not in said],
        "properties": {name: need for name, need in needs.items() if need and name not in said},
    }
    if "resample" not in said:
        points = {"anyOf": [{"required": [kind]} for kind in ("cloud", "net")]}
        alone |= {"if": {"properties": {"subject": {"not": points}}}, "then": {"required": ["resample"]}}
    return {**schema, "if": {"not": {"required": ["extends"]}}, "then": alone}


def defaults_schema() -> Schema:
    """Of `defaults.yaml`: the names of a shot, none of them needed."""
    schema = shot_schema()
    del schema["if"], schema["then"]
    return {**schema, "title": "Defaults of flowsculpt's shots"}


def film_schema() -> Schema:
    """Of a film file."""
    return _made(FilmDocument, "A film of flowsculpt")


class _Generator(GenerateJsonSchema):
    """pydantic's, with names that mean something to people."""

    schema_dialect = DIALECT

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        """Which form a value has is plain to see here: whichever fits."""
        forms = super().tagged_union_schema(schema)["oneOf"]
        different = [form for i, form in enumerate(forms) if form not in forms[:i]]
        return different[0] if len(different) == 1 else {"anyOf": different}

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        found, document = super().model_schema(schema), schema["cls"]
        del found["title"]
        if not issubclass(document, FlowParameters):
            found.pop("description", None)  # it speaks of the code
        for name, value in found["properties"].items():
            value.pop("title", None)
            if value.get("default", ...) is None:
                del value["default"]
            sense = hint(document, name)
            if sense is not None:
                value["description"] = in_a_line(sense)
        return found


def _made(document: type[BaseModel], title: str) -> Schema:
    schema = document.model_json_schema(schema_generator=_Generator)
    definitions = schema.get("$defs", {})
    for entry in (FlowDocument, VelocityDocument):
        if entry.__name__ in definitions:
            _tell_entries(definitions[entry.__name__]["properties"], definitions)
    return _renamed({"$schema": DIALECT, "title": title, **schema})


def _tell_entries(properties: Schema, definitions: Schema) -> None:
    """Each flow says what it does; its name alone will do (`- enright:`) where it needs nothing."""
    for entry in properties.values():
        flow = entry["anyOf"][0]
        there = definitions[_name(flow["$ref"])] if "$ref" in flow else {}
        there = there.get("anyOf", [there])[0]
        if not there or "required" in there:
            entry.update(flow)
            del entry["anyOf"]
        entry.setdefault("description", there.get("description", ""))


def _moved_needs(value: Schema, definitions: Schema) -> Schema:
    """What the documents that a name of a shot can hold need: taken out of these, which may rest on others'.

    Keys and formulas stay as they are: they replace others as a whole.
    """
    forms = [definitions[_name(form["$ref"])] for form in value.get("anyOf", [value]) if "$ref" in form]
    needs = [
        {word: form.pop(word)}
        for form in forms
        for word in ("required", "oneOf")
        if word in form and not {"keys", "formula"} & set(form.get("required", ()))
    ]
    return {"if": {"type": "object"}, "then": {"anyOf": needs}} if needs else {}


def _name(reference: str) -> str:
    return reference.removeprefix("#/$defs/")


def _renamed(schema: Schema) -> Schema:
    """With short names for the definitions: the class, without what pydantic makes of its parameters."""
    names: dict[str, str] = {}
    for name in schema.get("$defs", {}):
        short = re.sub(r"^pipeline__shot__|Document|Parameters|_?Annotated.*|_+$", "", name).strip("_")
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
