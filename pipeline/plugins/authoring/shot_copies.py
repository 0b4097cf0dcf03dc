"""Copies of shots in shots/, which name the same files, or copies of those outside of the project."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from flowsculpt.pipeline.production.request.lookup import SHOTS
from flowsculpt.pipeline.shot.yaml.yaml_source import flow_style

_WORDS = ("title", "intent")
"""Entries that name no file."""


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


def copied_shot(text: str, folder: Path, files: list[Path]) -> CopiedShot:
    """Return the copy of the text of a shot in a folder, which reads files.

    Files below this folder stay where they are. A copy of another keeps the name of its folder, if the shot
    names one, and so do the files that it names itself, such as the material library and pictures of an OBJ.
    """
    there, here = {file.resolve() for file in files}, Path.cwd().resolve()
    copies: dict[Path, Path] = {}
    final = today = text
    for node in reversed([*_names(YAML(typ="rt").compose(text))]):
        place = (folder / node.value).resolve()
        if place not in there and not any(fnmatch(file.as_posix(), place.as_posix()) for file in there):
            continue
        now = new = Path(os.path.relpath(place, SHOTS.resolve()))
        if not place.is_relative_to(here):
            new = Path(*place.parts[-2:]) if len(Path(node.value).parts) > 1 else Path(place.name)
            along = (file for file in there if file.is_relative_to(place.parent))
            copies |= {(SHOTS / new).parent / file.relative_to(place.parent): file for file in along}
        begin, end = node.start_mark.index, node.end_mark.index
        final = final[:begin] + flow_style(new.as_posix()) + final[end:]
        today = today[:begin] + flow_style(now.as_posix()) + today[end:]
    return CopiedShot(final, today, copies)


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
