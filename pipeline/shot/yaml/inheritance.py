"""Inheritance: a shot file over the shots that it extends, these over the defaults, and settings on top.

Mappings merge. Everything else replaces, also a mapping that defines another kind of thing: other keys, a
formula, another subject, another shape of the picture. Every value keeps its position. A setting of the
command line, `flows.0.vortex.strength=2`, replaces or adds a value and is its place in messages. Looks and
light rigs that the files name under `looks` and `rigs` stand in place of their names.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import MissingInputError, ShotError, UsageError, quote, shorten, suggest
from flowsculpt.pipeline.shot.motion import Clock, parse_frames, parse_rate
from flowsculpt.pipeline.shot.yaml.named_files import DEFAULTS, quote_name, shot_files, text_of
from flowsculpt.pipeline.shot.yaml.named_sets import set_of
from flowsculpt.pipeline.shot.yaml.yaml_source import (
    HEX_COLOUR,
    Spot,
    Where,
    YamlSource,
    dotted_path,
    in_yaml,
    to_yaml,
)
from flowsculpt.render.base.input_files import InputFile

OPTION = "--set"

_FORM = re.compile(r"\s*([^=\s]+?)\s*=(.*)", re.DOTALL)
_FRAME = re.compile(r"[+-]?\d+(\.\d+)?")
_TIME = re.compile(r"[+-]?\d+\.\d+s?")


def with_settings(source: YamlSource, settings: Iterable[str]) -> YamlSource:
    """Return the source with settings that replace or add values; later ones win.

    A value is YAML, as in the file. Mappings on the way to it are added where they are missing, but for flows
    and keys, which have to be there.
    A setting below the name of a look, of a light rig or of a stage keeps what the name stands for.
    Under `keys` a time is one name, also with a decimal point: `keys.0.5s=2`; a new one is sorted in. Raises
    ShotError, with the setting in place of a line, where one has no form or no place in the shot; the
    document checks its value.
    """
    for setting in settings:
        source = _set(source, setting)
    return source


def _set(source: YamlSource, setting: str) -> YamlSource:
    place = f"{OPTION} {shorten(setting)}"
    match = _FORM.fullmatch(setting)
    if not match:
        raise ShotError(f"{place}: not a setting; it must be name=value, such as flows.0.twist.amount=90")
    if re.search(r"[/\[\]]", match[1]):
        raise ShotError(f"{place}: not a setting; points join the names, as in flows.0.twist.amount=90")
    if match[1].split(".")[0] == "extends":
        raise ShotError(
            f"{place}: only a file can say what its shot extends; settings come on top of both. "
            "Write extends there, or set the values themselves."
        )
    try:
        given = YamlSource.read(Path(OPTION), _yaml_of(match[2].strip()))
    except ShotError:
        raise ShotError(
            f"{place}: {quote(match[2])} is not YAML. Quote it for the shell, and look at its brackets."
        ) from None
    data = copy.deepcopy(source.data)
    where = _put(data, match[1].split("."), given.data, place)
    _sort_keys(source, data, where)
    new = [where[:i] for i in range(1, len(where) + 1) if i == len(where) or where[:i] not in source.places]
    kept = source.without_places(lambda path: path[: len(where)] == where)
    spot = Spot(place, 0, 0, written=given.spot_of(()).written)
    return replace(kept, data=data, places={**kept.places, **dict.fromkeys(new, spot)})


def _yaml_of(text: str) -> str:
    """Return the value of a setting as YAML: nothing is null, and a colour is no comment."""
    return to_yaml(text, "'") if HEX_COLOUR.fullmatch(text) else text or "null"


def _put(data: Any, steps: list[str], value: Any, place: str) -> Where:
    """Put a value where the steps lead, and return its path with the keys as they are in the data."""
    where: Where = ()
    parent, holder, steps = data, data, list(steps)
    while steps:
        name = ".".join(map(str, where)) or "the shot"
        step = _take(steps, holder, in_keys=where[-1:] == ("keys",))
        bases = (b for names, entry, b in NAMED_SETTINGS if where[-1:] == (entry,) or where[:-1] == (names,))
        if isinstance(holder, str) and (base_name := next(bases, None)):
            parent[where[-1]] = holder = {base_name: holder}
        if isinstance(holder, list):
            if not step.isdigit() or int(step) >= len(holder):
                raise ShotError(f"{place}: {name} has no item {step}. {_items(name, holder, step, steps)}")
            key: Any = int(step)
        elif isinstance(holder, dict):
            key = _key(holder, step)
            if steps and key not in holder:
                if holder and ("keys" in where or any(isinstance(part, int) for part in where)):
                    raise ShotError(f"{place}: {name} has no {step}. {_hint(where, step, holder)}")
                holder[key] = {}
            if steps and holder[key] is None:
                holder[key] = {}
        else:
            inner = dotted_path((*where[:-1], step)) if len(where) > 1 and isinstance(holder, str) else ""
            raise ShotError(
                f"{place}: {name} is {in_yaml(holder)}, not a mapping with {step}. Set {name}={{{step}: …}} "
                f"in its place{inner and f', or {inner} next to it'}."
            )
        where = (*where, key)
        if not steps:
            if where[:-1] == ("picture",):  # aspect and size exclude each other
                holder.clear()
            holder[key] = value
        else:
            parent, holder = holder, holder[key]
    return where


def _items(name: str, holder: list[Any], step: str, steps: list[str]) -> str:
    """Return the items that a list has, or the path to the one that a step names."""
    first = [next(iter(item), "") if isinstance(item, dict) else "" for item in holder]
    if step in first:
        return f"Write {'.'.join([name, str(first.index(step)), step, *steps])}."
    numbered = [f"{i} ({word})" if word else str(i) for i, word in enumerate(first)]
    return f"There are: {', '.join(numbered)}." if holder else "It is empty."


def _hint(where: Where, step: str, holder: dict[Any, Any]) -> str:
    """Return the names that exist; times get no did-you-mean."""
    if where[-1] == "keys":
        return f"There are: {', '.join(map(str, holder))}. Set a new key as a whole."
    return suggest(step, map(str, holder))


def _take(steps: list[str], holder: Any, in_keys: bool) -> str:
    """Remove the next name from the steps and return it: under `keys` two steps, if together they are a time.

    `keys.17.1` is the second number of key 17 if that is a list, and otherwise key 17.1.
    """
    joined = ".".join(steps[:2])
    if isinstance(holder, dict) and joined in holder and steps[0] not in holder:  # such as a plug-in's flow
        del steps[:2]
        return joined
    if in_keys and isinstance(holder, dict) and len(steps) > 1 and _TIME.fullmatch(joined):
        item = holder.get(_key(holder, steps[0]))
        if _key(holder, joined) in holder or not isinstance(item, list | dict):
            del steps[:2]
            return joined
    return steps.pop(0)


def _key(holder: dict[Any, Any], step: str) -> Any:
    """Return the key of a mapping that is written like a step, or else a new one."""
    new: Any = step
    if _FRAME.fullmatch(step):
        new = float(step) if "." in step else int(step)
    return next((name for name in holder if str(name) == step), new)


def _sort_keys(source: YamlSource, data: Any, where: Where) -> None:
    """Sort a new key in among the others, if those ascend and all are times."""
    if "keys" not in where[:-1]:
        return
    holder = data
    for step in where[: where.index("keys")]:
        holder = holder[step]
    try:
        clock = Clock(parse_frames(data["frames"]), parse_rate(data.get("rate")))
    except (UsageError, KeyError, TypeError):
        return  # the file's own checks report these
    times = {key: clock.seconds(key) for key in holder["keys"]}
    known = [time for time in times.values() if time is not None]
    if len(known) == len(times) and known[:-1] == sorted(known[:-1]):
        holder["keys"] = dict(sorted(holder["keys"].items(), key=lambda item: times[item[0]] or 0.0))


KIND_NAMES = frozenset({"keys", "formula", "curvature", "camera", "solid", "model", "cloud", "net", "bsdf"})
"""Names that define the kind of their mapping: one that has any of them replaces the inherited mapping."""

WHOLE = frozenset({("picture",)})
"""Mappings whose names exclude each other: one replaces an inherited one."""

ReadText = Callable[[str], str | None]
"""Returns the text of a file beside the shot by its name; None if there is none."""


def inherited_source(
    path: Path, text: str | None, settings: tuple[str, ...], beside: Mapping[str, str] | None
) -> YamlSource:
    """Return a shot file with everything it inherits, and settings of the command line on top.

    Raises ShotError and MissingInputError, with the place, where a file is not YAML or not there, where shots
    extend each other in a circle, and where a setting has no place in the shot.
    """
    read_text = beside.get if beside is not None else lambda name: _text(path.with_name(name))
    source = _extended(YamlSource.read(path, text), read_text, (path.name,))
    written = read_text(DEFAULTS) if path.name != DEFAULTS else None
    if isinstance(source.data, dict):
        base = (written and _require_mapping(YamlSource.read(path.with_name(DEFAULTS), written))) or None
        preset, defaults, is_own = set_of(source, base, settings)
        layers = (preset, defaults) if is_own else (defaults, preset)
        for layer in layers:
            source = source if layer is None else over(source, layer)
    return with_named_settings(with_settings(source, settings))


NAMED_SETTINGS = (("looks", "look", "material"), ("rigs", "lights", "rig"), ("", "stage", "kind"))
"""Names of settings, if any, where these stand, and which of their names says what they are based on."""

_ALTERNATIVES = frozenset({"colour", "pigment", "measure"}), frozenset({"sky", "sun", "hdri"})
"""Settings of a look, and of lights: each replaces the others of its set."""


def with_named_settings(source: YamlSource) -> YamlSource:
    """Return the source with what `looks` and `rigs` hold in place of their names, at positions of their own.

    What stands beside a name replaces single values, except softboxes, which are added.
    """
    for names, entry, base_name in NAMED_SETTINGS:
        named = source.mapping(names)
        places: list[Where] = [(entry,)]
        places += [("subjects", name, entry) for name in source.mapping("subjects")]
        places += [("overrides", index, entry) for index in range(len(source.listing("overrides")))]
        for where in places if named else ():
            seen: set[Any] = set()
            while (name := _name_at(source, where, base_name)) in named and name not in seen:
                seen.add(name)
                source = _spelt_out(source, where, (names, name), base_name)
    return source


def _name_at(source: YamlSource, where: Where, base_name: str) -> Any:
    """Return the name of a look or rig that a value is, or is based on; None where there is none."""
    value = source.get(*where)
    name = value.get(base_name) if isinstance(value, dict) else value
    return name if isinstance(name, str) else None


def _spelt_out(source: YamlSource, where: Where, named: Where, base_name: str) -> YamlSource:
    """Return the source with the settings at `named` below those that stand at `where`."""
    own, base = source.get(*where), source.get(*named)
    own = {name: value for name, value in own.items() if name != base_name} if isinstance(own, dict) else {}
    base = dict(base) if isinstance(base, dict) else {base_name: base}
    for group in _ALTERNATIVES:
        if group & own.keys():
            base = {name: value for name, value in base.items() if name not in group}
    merged = _merged(own, base, (), set())
    first, others = own.get("softboxes"), base.get("softboxes")
    shift = 0
    if isinstance(first, list) and isinstance(others, list):
        merged["softboxes"], shift = [*first, *others], len(first)
    data = copy.deepcopy(source.data)
    holder = data
    for step in where[:-1]:
        holder = holder[step]
    holder[where[-1]] = merged
    found = source.without_places(lambda path: path == (*where, base_name))
    for path, spot in source.places.items():
        inner = path[len(named) :]
        if path[: len(named)] == named and inner:
            if inner[0] == "softboxes" and len(inner) > 1:
                inner = (inner[0], inner[1] + shift, *inner[2:])
            found.places.setdefault((*where, *inner), spot)
    return replace(found, data=data)


def inherited_files(path: Path, text: str) -> dict[str, str]:
    """Return the texts of all other files that a shot inherits from, by name.

    The search ends at files that are missing or not YAML, which `inherited_source` reports.
    """
    texts: dict[str, str] = {}

    def read_text(name: str) -> str | None:
        if (content := _text(path.with_name(name))) is not None:
            texts[name] = content
        return content

    with suppress(ShotError, MissingInputError):
        read_text(DEFAULTS)
        _extended(YamlSource.read(path, text), read_text, (path.name,))
    return texts


def _extended(source: YamlSource, read_text: ReadText, chain: tuple[str, ...]) -> YamlSource:
    """Return a file over the one that it extends, and that over the next."""
    parent = source.get("extends")
    if not isinstance(parent, str):
        return source
    name, place = f"{parent}.yaml", source.place(("extends",))
    if name in chain:
        circle = " extends ".join(Path(link).stem for link in (*chain[chain.index(name) :], name))
        raise ShotError(f"{place}: {circle}; a shot cannot extend itself. Take one of them out.")
    text = read_text(name) if "/" not in parent else None
    if text is None:
        known = [file.stem for file in shot_files(source.path.parent) if file.name not in chain]
        hint = suggest(parent, known) if known else "No other shot is there; remove extends."
        if Path(parent).name.removesuffix(".yaml") in known:
            hint = f"Write {Path(parent).name.removesuffix('.yaml')}, its name without folder and suffix."
        raise MissingInputError(f"{place}: extends: {quote_name(parent)} is not next to this file. {hint}")
    base = _require_mapping(YamlSource.read(source.path.with_name(name), text))
    return over(source, _extended(base, read_text, (*chain, name)))


def over(source: YamlSource, base: YamlSource) -> YamlSource:
    """Return the values of `source`, and those of `base` that it does not have."""
    if not isinstance(source.data, dict):
        return source
    replaced: set[Where] = set()
    for one, other in (("subject", "subjects"), ("subjects", "subject")):
        if one in source.data and other in base.data:
            base = replace(base, data={name: value for name, value in base.data.items() if name != other})
            replaced.add((other,))
    data = _merged(source.data, base.data, (), replaced)

    kept = base.without_places(
        lambda where: where in source.places or any(where[:i] in replaced for i in range(len(where) + 1))
    )
    places, problems = {**kept.places, **source.places}, list(source.problems)
    for i, (where, problem) in enumerate(base.problems):  # reported even where their values are replaced
        places[base.path.name, i] = base.spot_of(where)
        problems.append(((base.path.name, i), problem))
    return YamlSource(source.path, data, places, problems)


def _merged(value: Any, base: Any, where: Where, replaced: set[Where]) -> Any:
    """Return a value merged over a base; add the paths where the base is replaced as a whole."""
    both = isinstance(value, dict) and isinstance(base, dict)
    if not both or where in WHOLE or (where and KIND_NAMES & set(value)):
        replaced.add(where)
        return value
    merged = dict(base)
    for name, item in value.items():
        merged[name] = _merged(item, base[name], (*where, name), replaced) if name in base else item
    return merged


def _require_mapping(base: YamlSource) -> YamlSource:
    if not isinstance(base.data, dict):
        raise ShotError(
            f"{base.path}:1:1: this is not a mapping; a file that shots inherit from is `name: value`"
        )
    return base


def _text(path: Path) -> str | None:
    """Return the text of a file, None if there is none. Raises what `text_of` raises."""
    return text_of(path) if InputFile(path).is_there() else None
