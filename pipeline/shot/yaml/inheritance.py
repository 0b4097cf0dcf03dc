"""Inheritance: a shot file over the shots that it extends, these over the defaults, and settings on top.

Mappings merge. Everything else replaces, also a mapping that defines another kind of thing: other keys, a
formula, another subject, another shape of the picture. Every value keeps its position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError, ShotError, suggestion
from pipeline.shot.yaml.lookup import DEFAULTS, is_there, shown, text_of
from pipeline.shot.yaml.settings import with_settings
from pipeline.shot.yaml.source import Where, YamlSource
from render.scene.quality import FORMER_NAMES

KIND_NAMES = frozenset({"keys", "formula", "curvature", "camera", "solid", "model", "cloud", "net", "bsdf"})
"""Names that define the kind of their mapping: one that has any of them replaces the inherited mapping."""

WHOLE = frozenset({("picture",)})
"""Mappings whose names exclude each other: one replaces an inherited one."""

ReadText = Callable[[str], str | None]
"""Returns the text of a file beside the shot by its name; None if there is none."""


def inherited(
    path: Path, text: str | None, settings: tuple[str, ...], beside: Mapping[str, str] | None
) -> YamlSource:
    """Return a shot file with everything it inherits, and settings of the command line on top.

    Raises ShotError and MissingInputError, with the place, where a file is not YAML or not there, where shots
    extend each other in a circle, and where a setting has no place in the shot.
    """
    read_text = beside.get if beside is not None else lambda name: _text(path.with_name(name))
    source = _extended(_read(path, text), read_text, (path.name,))
    defaults = read_text(DEFAULTS) if path.name != DEFAULTS else None
    if defaults is not None and isinstance(source.data, dict):
        source = over(source, _require_mapping(_read(path.with_name(DEFAULTS), defaults)))
    return with_settings(source, settings)


def inherited_files(path: Path, text: str) -> dict[str, str]:
    """Return the texts of all other files that a shot inherits from, by name.

    The search ends at files that are missing or not YAML, which `inherited` reports.
    """
    texts: dict[str, str] = {}

    def read_text(name: str) -> str | None:
        content = _text(path.with_name(name))
        if content is not None:
            texts[name] = content
        return content

    try:
        read_text(DEFAULTS)
        _extended(_read(path, text), read_text, (path.name,))
    except (ShotError, MissingInputError):
        return texts
    return texts


def _read(path: Path, text: str | None) -> YamlSource:
    """Read a file with the names of qualities of today. One that is there beside its former name stays."""
    source = YamlSource.read(path, text)
    for former, name in FORMER_NAMES.items():
        given = source.get("quality")
        if isinstance(given, dict) and former in given and name not in given:
            source = source.renamed(("quality", former), name)
    return source


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
        known = sorted(p.stem for p in source.path.parent.glob("*.yaml") if p.name not in (*chain, DEFAULTS))
        hint = suggestion(parent, known) if known else "No other shot is there; remove extends."
        if Path(parent).name.removesuffix(".yaml") in known:
            hint = f"Write {Path(parent).name.removesuffix('.yaml')}, its name without folder and suffix."
        raise MissingInputError(
            f"{place}: there is no shot {shown(parent)} beside this file to extend. {hint}"
        )
    base = _require_mapping(_read(source.path.with_name(name), text))
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
    others = {where: kept.others.get(where, str(base.path)) for where in kept.places}
    problems = []
    for i, (where, problem) in enumerate(base.problems):  # reported even where their values are replaced
        file, line, column = base.spot_of(where)
        others[base.path.name, i], source.places[base.path.name, i] = file, (line, column)
        problems.append(((base.path.name, i), problem))
    return YamlSource(
        source.path,
        data,
        {**kept.places, **source.places},
        [*source.problems, *problems],
        {**kept.texts, **source.texts},
        {**others, **source.others},
        {**kept.written, **source.written},
    )


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
            f"{base.path}:1:1: this is no mapping; a file that shots inherit from is `name: value`"
        )
    return base


def _text(path: Path) -> str | None:
    """Return the text of a file, None if there is none. Raises what `text_of` raises."""
    return text_of(path) if is_there(path) else None
