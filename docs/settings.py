"""Write settings.md, the page of every setting of shot files and edits, from the models that check them.

`make reference` runs it; a test holds the page to what the models say.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.plugins.authoring.document_schemas import schema_of
from flowsculpt.pipeline.plugins.authoring.reference import Schema
from flowsculpt.pipeline.shot.documents.shot_documents import FilmDocument, ShotDocument

PAGE = Path(__file__).with_suffix(".md")

INTRODUCTION = """# Every setting

All that a shot file and an edit may hold, from the models that check them; `make reference` writes this page.
[Shot files](shot-files.md) explains them by examples. What is *keyed* may change
[over time](#values-over-time)."""

FLOWS = """
## Flows

Each entry of `flows` is one of these, by its name; entries of `sum` are those of velocities.
[Flows](flows.md) shows pictures and formulas.
"""

FILM = """
## An edit

`shots/film.yaml`, and others beside it: the shots of a film in their order."""

OVER_TIME = ("Keyed", "Key", "OverTime", "FromSound", "FromSoundTriple")
_OVER_TIME = re.compile(r"Keyed\d*|OverTime|OverTimeTriple|FromSound|FromSoundTriple|Key\d+")
"""Definitions that differ in the bounds of their values alone; those of OVER_TIME are written out."""

LIMITS = {-1e12, 1e12, 1e11, 1e-9}
"""Bounds of numbers that shot-files.md tells once for all."""

KINDS = {"string": "text", "boolean": "`true`, `false`", "number": "number", "integer": "whole number"}


class SchemaPage:
    """The definitions of a JSON Schema as sections of a page, in the order in which they are first named."""

    def __init__(self, schema: Schema) -> None:
        self.definitions: dict[str, Schema] = schema.get("$defs", {})
        self._named: list[str] = []

    def section(self, heading: str, schema: Schema) -> Iterator[str]:
        """Yield a heading, the description, and a table of the settings."""
        yield f"\n{heading}\n"
        if schema.get("description"):
            yield f"{schema['description']}\n"
        yield from ("| setting | values | default | |", "|---|---|---|---|")
        needed = schema.get("required", ())
        for name, value in schema.get("properties", {}).items():
            default = "needed" if name in needed else _default(value.get("default"))
            yield f"| `{name}` | {self.values(value)} | {default} | {_cell(value.get('description', ''))} |"

    def named_sections(self, left_out: frozenset[str] = frozenset()) -> Iterator[str]:
        """Yield the sections of all definitions named so far, and of those that they name in turn."""
        for name in self._named:  # grows while it is read
            if name not in left_out:
                yield from self.section(f"### {title(name)}", self.definitions[name])

    def values(self, schema: Schema) -> str:
        """Return in words what a setting may hold."""
        return " or ".join(dict.fromkeys(form for form in self._forms(schema) if form))

    def _forms(self, schema: Schema) -> Iterator[str]:
        alternatives = schema.get("anyOf", ())
        if "$ref" in schema:
            yield self._link(_referred(schema))
        elif "const" in schema:
            yield f"`{schema['const']}`"
        elif "enum" in schema:
            yield ", ".join(f"`{word}`" for word in schema["enum"])
        elif alternatives and "type" not in schema:
            for alternative in alternatives:
                yield from self._forms(alternative)
        else:
            kinds = schema.get("type", "object")
            for kind in [kinds] if isinstance(kinds, str) else kinds:
                yield self._kind(kind, schema)

    def _link(self, name: str) -> str:
        if _OVER_TIME.fullmatch(name):
            return "[keyed](#values-over-time)"
        if name in ("Flow", "Velocity"):
            return "[flows](#flows)"
        if name not in self._named:
            self._named.append(name)
        return f"[{title(name).lower()}](#{anchor(title(name))})"

    def _kind(self, kind: str, schema: Schema) -> str:
        if kind == "array":
            return self._list(schema)
        if kind == "object":
            inner = schema.get("additionalProperties")
            return f"names with {self.values(inner)}" if isinstance(inner, dict) else "names with values"
        return KINDS.get(kind, "") + (_bounds(schema) if kind in ("number", "integer") else "")

    def _list(self, schema: Schema) -> str:
        items, least, most = schema.get("items", {}), schema.get("minItems"), schema.get("maxItems")
        many = str(least) if least is not None and least == most else ""
        if items.get("type") == "number":
            return f"{many or 'list of'} numbers{_bounds(items)}"
        inner = self.values(items) if items else "values"
        return f"list of {many} {inner}".replace("  ", " ")


def page() -> str:
    """Return the whole page."""
    shot, film = schema_of(ShotDocument, "A shot"), schema_of(FilmDocument, "A film")
    sections = SchemaPage(shot)
    lines = [INTRODUCTION, *sections.section("## A shot", shot), *sections.named_sections(), FLOWS]
    written = len(lines)
    entries = sections.definitions["Flow"]["properties"]
    lines += ["| flow | |", "|---|---|"]
    lines += [
        f"| [`{name}`](#{anchor(name)}) | {_cell(_summary(entry))} |" for name, entry in entries.items()
    ]
    for name, entry in entries.items():
        lines += _flow(sections, name, entry)
    lines += [line for line in sections.named_sections() if line not in lines[:written]]
    lines.append("\n## Values over time\n\nIn place of a number or a vector that may be keyed.")
    for name in OVER_TIME:
        lines += sections.section(f"### {title(name)}", sections.definitions[name])
    clips = SchemaPage(film)
    film_sections = [
        *clips.section("### Film", film),
        *clips.named_sections(frozenset({"Sound", "PictureShape"})),
    ]  # those of a shot
    return "\n".join([*lines, FILM, *film_sections]) + "\n"


def _flow(sections: SchemaPage, name: str, entry: Schema) -> Iterator[str]:
    """Yield the section of a flow; flows that hold flows alone have no table."""
    forms = [form for form in entry.get("anyOf", [entry]) if "$ref" in form]
    definition = sections.definitions[_referred(forms[0])] if forms else {}
    definition = definition.get("anyOf", [definition])[0]
    if "properties" in definition:
        yield from sections.section(f"### {name}", {**definition, "description": _summary(entry)})
    else:
        yield f"\n### {name}\n\n{_summary(entry)}\n\nHolds {sections.values(entry)}."


def _summary(entry: Schema) -> str:
    text = entry.get("description", "")
    return text[:1].upper() + text[1:]


def _referred(schema: Schema) -> str:
    return schema["$ref"].rpartition("/")[2]


def _bounds(schema: Schema) -> str:
    """Return the bounds of a number, after a comma; those of all numbers are left out."""
    least, most, above, below = (
        None if schema.get(word) in LIMITS else schema.get(word)
        for word in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
    )
    if least is not None and most is not None:
        return f", {_plain(least)} to {_plain(most)}"
    known = {"above": above, "at least": least, "below": below, "at most": most}
    return "".join(f", {word} {_plain(bound)}" for word, bound in known.items() if bound is not None)


def _plain(number: float) -> str:
    return f"{number:,}".replace(",", " ").removesuffix(".0")


def _default(value: Any) -> str:
    if value in (None, "", []) or isinstance(value, dict):
        return ""
    text = value if isinstance(value, str) else re.sub(r"\.0(?!\d)", "", json.dumps(value))
    return f"`{text}`"


def title(name: str) -> str:
    """Return the heading of a definition: its name in words."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return words[:1].upper() + words[1:]


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
