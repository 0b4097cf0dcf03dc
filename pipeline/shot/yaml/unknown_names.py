"""Messages about unknown names: what is meant, where it belongs, or which names there are."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ValidationError

from pipeline.errors import MOST_QUOTED, suggestion
from pipeline.shot.yaml.misplaced_names import (
    CheckedMapping,
    UnknownNames,
    further_down,
    further_up,
    owner_beside,
    tell_beside,
)
from pipeline.shot.yaml.plain_text import dotted, in_yaml, listed
from pipeline.shot.yaml.schema_walk import (
    choices,
    field_names,
    models_in,
    needed_names,
    types_at,
    without_tags,
)
from pipeline.shot.yaml.synonyms import (
    FLOW_REMEDIES,
    REMEDIES,
    RENAMED,
    SHAPE_WORDS,
    VALUES,
    as_name,
    synonym,
)
from pipeline.shot.yaml.yaml_source import Where, YamlSource

_NAMED_BY = ("type", "name", "flow", "kind")
"""Words under which other formats have the name of a thing that a shot has as a key."""

MOST_BRIEF = 8
"""Most names of all forms of a mapping together in one message."""


def unknown_names(document: type[BaseModel], source: YamlSource, locs: Iterable[Where]) -> UnknownNames:
    """Return the messages about names that pydantic does not know, by their paths there."""
    found = UnknownNames()
    by_mapping: dict[Where, list[Where]] = {}
    for loc in locs:
        by_mapping.setdefault(loc[:-1], []).append(loc)
    for mapping, inside in by_mapping.items():
        kinds = types_at(document, mapping)
        every = models_in(types_at(document, without_tags(mapping)))
        checked = CheckedMapping(document, source, without_tags(mapping), models_in(kinds), every, found)
        _explain(checked, [loc[-1] for loc in inside])
    return found


def _explain(mapping: CheckedMapping, unknown: list[Any]) -> None:
    """Report the unknown names of a mapping; of several with one explanation, the first."""
    told: set[str] = set()
    if _is_named_by_value(mapping, unknown):
        return
    beside: dict[Any, list[Any]] = {}
    for name in unknown:
        owner = None if _shape(mapping, name) else owner_beside(mapping, name)
        if owner is None:
            message = _message(mapping, name)
            if message.partition(".")[2] not in told or "Rename" in message:
                mapping.tell(name, message)
            told.add(message.partition(".")[2])
        else:
            beside.setdefault(owner, []).append(name)
    for owner, names in beside.items():
        tell_beside(mapping, owner, names)


def _is_named_by_value(mapping: CheckedMapping, unknown: list[Any]) -> bool:
    """Report `{type: twist, amount: 80}`, which is `twist: {amount: 80}`."""
    for name in unknown:
        value = mapping.values[name]
        if name not in _NAMED_BY or not isinstance(value, str) or not mapping.is_entry:
            continue
        if value not in mapping.fields:
            continue
        rest = {key: item for key, item in mapping.values.items() if key != name}
        mapping.tell(name, f"a flow stands under its name. Write {value}: {in_yaml(rest)}.")
        mapping.found.covered.add(mapping.where)
        return True
    return False


def _message(mapping: CheckedMapping, name: Any) -> str:
    under = f" under {mapping.name}" if mapping.where else ""
    if (new := RENAMED.get(name)) in mapping.fields:
        mapping.found.supplied.add((*mapping.where, new))
        return f"{name} is called {new} now{under}. Rename it."
    for explain in (_shape, _misspelt, _other_form, _synonym, _chosen, further_down, further_up):
        if (message := explain(mapping, name)) is not None:
            return message
    return f"{name} is not known{under}. {_remedy(mapping, name)}"


def _shape(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about the shape of the picture where a shot or an edit, camera or quality has it."""
    value, word = mapping.values[name], as_name(name)
    is_units = len(value) == 3 if isinstance(value, list) else isinstance(value, int | float) and value < 16
    if word not in SHAPE_WORDS or mapping.where[:1] not in ((), ("camera",), ("quality",)):
        return None
    if is_units and word in ("size", "width", "height"):
        return None
    aspect, size = '{aspect: "9:16"}', "{size: [1080, 1920]}"
    if len(numbers := re.findall(r"\d{2,}", in_yaml(value))) == 2:
        size = f"{{size: [{', '.join(numbers)}]}}"
    fact = f"{name} is not known under {mapping.name}." if mapping.where else f"{name} is not known."
    if mapping.is_set(name):
        return f"{fact} Set picture='{aspect}', or picture='{size}'."
    top = " at the top of the file" if mapping.where else ""
    return f"{fact} Write picture: {aspect}, or picture: {size}{top}."


def _misspelt(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about marks and capitals that are no part of the name."""
    text = str(name)[:MOST_QUOTED]
    if text.startswith("-") and as_name(text[1:]) in mapping.fields:
        return f"a space is missing after the dash. Write - {text[1:]}: …"
    for mark, fact in ((":", "a space is missing after the colon"), ("=", "a colon ends a name, not =")):
        first = text.partition(mark)[0].strip()
        if mark in text and as_name(first) in mapping.fields:
            mapping.found.supplied.add((*mapping.where, first))
            return f"{fact}. Write {first}: …"
    brace = re.fullmatch(r"([\w ]+?)\s*(\{.*)", text)
    if brace and as_name(brace[1]) in mapping.fields:
        mapping.found.covered.add(mapping.where)
        dash = "- " if mapping.is_entry else ""
        rest = f"{brace[2]}: {in_yaml(mapping.values[name])}"
        return f"a colon is missing after {brace[1]}. Write {dash}{as_name(brace[1])}: {rest}."
    spelt = as_name(name)
    if spelt in mapping.fields and spelt != name:
        mapping.found.supplied.add((*mapping.where, spelt))
        return f"{name} is written {spelt}. Rename it."
    return None


def _other_form(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about a name that another form of this mapping has: size beside a model."""
    others = [model for model in mapping.every if name in field_names([model])]
    if not others or not mapping.where:
        return None
    mine, theirs = needed_names(mapping.models), needed_names(others[:1])
    if name in theirs:
        return f"{mapping.name} has {listed([*mine, name])}; it is one of them. Remove the others."
    kind = "subject" if mapping.where[0] == "subjects" else mapping.where[-1]
    return f"{name} is for a {kind} with {listed(theirs)}, not with {listed(mine)}. Remove it."


def _synonym(mapping: CheckedMapping, name: Any) -> str | None:
    new = synonym(name, [each for each in mapping.fields if each not in mapping.beside(name)])
    if new is None:
        new = synonym(name, field_names(mapping.every))
        if new is None:
            return None
        if new in mapping.beside(name):
            remedy = f"Set {dotted((*mapping.where, new))}" if mapping.is_set(name) else "Remove one of them"
            return f"{name} is called {new} in {mapping.here}, which is there. {remedy}."
        mapping.found.covered.add(mapping.where)
    mapping.found.supplied.add((*mapping.where, new))
    return f"{name} is called {new} in {mapping.here}. {_rename(mapping, name, new)}"


def _rename(mapping: CheckedMapping, name: Any, new: str) -> str:
    """Return the remedy for another name; if its value does not fit there, with one that does."""
    for model in mapping.models:
        try:
            model.model_validate({new: mapping.values[name]})
        except ValidationError as error:
            for each in error.errors():
                proposed = re.search(r"Write (\[.*?\])\.", str(each["msg"]))
                if proposed and each["loc"][0] == new:
                    inner = [step for step in each["loc"] if not str(step).startswith("form ")]
                    text = proposed[1]
                    for step in reversed(inner[1:]):
                        text = f"{{{step}: {text}}}"
                    return f"Write {new}: {text}."
    return "Rename it."


def _chosen(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about a value that stands as a name: `{box: {size: …}}`."""
    for owner, kind in field_names(mapping.every).items():
        if name in choices(kind) and owner not in mapping.values:
            mapping.found.covered.add(mapping.where)
            below = mapping.values[name]
            rest = {owner: name, **(below if isinstance(below, dict) else {})}
            return f"{name} is a value of {owner}. Write {in_yaml(rest)}."
    return None


def _remedy(mapping: CheckedMapping, name: Any) -> str:
    in_flows = FLOW_REMEDIES if "flows" in mapping.where[:3] else {}
    if (remedy := in_flows.get(as_name(name)) or REMEDIES.get(as_name(name))) is not None:
        mapping.found.covered.add(mapping.where)
        return f"{remedy}."
    every = field_names(mapping.every)
    names = sorted(every if len(every) <= MOST_BRIEF else mapping.fields)
    if (meant := VALUES.get(as_name(name))) in names:
        return f"Did you mean {meant!r}?"
    listing = ""
    if mapping.is_entry:
        listing = "`flowsculpt flows` lists all of them."
    elif not mapping.where:
        listing = "docs/shot-files.md explains all of them."
    hint = suggestion(name, names, listing=listing)
    mapping.found.supplied.update(
        (*mapping.where, each) for each in names if hint == f"Did you mean {each!r}?"
    )
    return hint
