"""Copies of shots in shots/, with what they inherit, which name the same files, or copies of others."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from flowsculpt import UsageError
from flowsculpt.api.frames import Show
from flowsculpt.api.shots import WrittenShot, YamlSource, to_yaml

_WORDS = ("title", "intent")
"""Entries that name no file."""

INHERITED = ("extends", "looks", "rigs")
"""Entries whose effect is spelt out in a copy."""

_COMMENTS = re.compile(r"(?:^[ \t]*(?:#.*)?\n)+\Z", re.MULTILINE)
"""The comments between an entry and the next, which belong to the next."""


@dataclass(frozen=True)
class CopiedShot:
    """The text of a shot in shots/ that was made from one in another folder.

    text    with names relative to shots/, as it will be
    today   with names that lead to the files where they are now
    copies  the files outside of the project, by the paths of their copies
    """

    text: str
    today: str
    copies: dict[Path, Path] = field(default_factory=dict)


def copied_shot(path: Path, text: str, files: list[Path], keeps_files: bool) -> CopiedShot:
    """Return the copy of a shot that reads files, from its text, which may differ from that of its file.

    keeps_files  True if files below this folder stay where they are

    A copy of a file keeps its place below the folder of the shot; of others, the name of their folder, if the
    shot names one. So do the files that it names itself, such as the material library and pictures of an OBJ.
    Raises UsageError where one of those lies elsewhere.
    """
    folder, here = path.parent.resolve(), Path.cwd().resolve()
    there = {file.resolve() for file in files}
    copies: dict[Path, Path] = {}
    final = today = text
    for node in reversed([*_names(YamlSource.tree(text))]):
        place = (folder / node.value).resolve()
        if place not in there and not any(fnmatch(file.as_posix(), place.as_posix()) for file in there):
            continue
        new = Path(os.path.relpath(place, Show().folder.resolve()))
        if not (keeps_files and place.is_relative_to(here)):
            new = Path(*place.parts[-2:]) if len(Path(node.value).parts) > 1 else Path(place.name)
            new = place.relative_to(folder) if place.is_relative_to(folder) else new
            along = (file for file in there if file.is_relative_to(place.parent))
            copies |= {(Show().folder / new).parent / file.relative_to(place.parent): file for file in along}
        begin, end = node.start_mark.index, node.end_mark.index
        final = final[:begin] + to_yaml(new.as_posix()) + final[end:]
        today = today[:begin] + to_yaml(place.as_posix()) + today[end:]
    for file in sorted(there - {*copies.values()}):
        if not (keeps_files and file.is_relative_to(here)):
            raise UsageError(
                f"{file} is named by another file, of another folder; copy both into {Show().folder}"
            )
    return CopiedShot(final, today, copies)


def whole_text(path: Path) -> str:
    """Return the text of a shot with what it inherits from files beside it, which its copy does not have.

    Entries that inherit nothing stay as they are written. Raises ShotError and MissingInputError.
    """
    text = YamlSource.read_text(path)
    source, node = WrittenShot.read(path, text).source, YamlSource.tree(text)
    if all(spot.file == str(path) for spot in source.places.values()) or not isinstance(node, MappingNode):
        return text
    own, whole = YamlSource.read(path, text).data, source.data
    begins = [name.start_mark.index for name, _ in node.value]
    entries = [text[begin:end] for begin, end in zip(begins, [*begins[1:], len(text)], strict=True)]
    written = {name.value: entry for (name, _), entry in zip(node.value, entries, strict=True)}
    lines = ["" if node.flow_style else text[: begins[0]]]
    for name in dict.fromkeys((*own, *whole)):
        entry = written.get(name, "")
        if name in INHERITED or own.get(name) != whole[name] or node.flow_style:
            comments = _COMMENTS.search(entry)
            spelt_out = "" if name in INHERITED else f"{to_yaml(name)}: {to_yaml(whole[name])}\n"
            entry = f"{spelt_out}{comments[0] if comments else ''}"
        lines.append(f"{entry}\n" if entry[-1:] not in ("", "\n") else entry)
    return "".join(lines)


def _names(node: Node | None) -> Iterator[Any]:
    """Yield the scalars of a YAML document that may name files, in the order of the text."""
    if isinstance(node, ScalarNode):
        yield node
    elif isinstance(node, SequenceNode):
        for item in node.value:
            yield from _names(item)
    elif isinstance(node, MappingNode):
        for name, value in node.value:
            if name.value not in _WORDS:
                yield from _names(value)
