"""Which plug-ins a test needs besides the one in whose folder it lies.

A test says so with `@needs_plugins("sheets")`, or imports a module of the plug-in. Either skips it where that
plug-in is not installed; where all of flowsculpt is, nothing is skipped.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import pytest
from _pytest.mark import ParameterSet

from flowsculpt.pipeline.plugin import plugins

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "shots"

ADDED = tomllib.loads((ROOT / "pipeline/plugins/added.toml").read_text(encoding="utf-8"))
"""What each plug-in adds that comes with flowsculpt."""

SHIPPED = tuple(ADDED)

NEEDS = re.compile(r"# Needs the plug-ins? (.*)\.\n")
"""The first line of a shot of the gallery that needs plug-ins."""

OF_PLUGIN = re.compile(r"(?:flowsculpt\.pipeline|tests)\.plugins\.(\w+)")


def missing(*names: str) -> list[str]:
    """Return those of some plug-ins that are not installed."""
    return [name for name in names if name not in plugins().loaded]


def needs_plugins(*names: str) -> pytest.MarkDecorator:
    """Mark a test, a class, a module or a row of a table that needs plug-ins."""
    return pytest.mark.skipif(bool(missing(*names)), reason=_reason(*missing(*names)))


def _reason(*names: str) -> str:
    return f"needs the plug-in {' and '.join(names)}, which is not installed"


class MissingPlugins(MetaPathFinder):
    """Skips the test, or the module of tests, that imports from a plug-in which is not installed.

    Python asks it last, so only for modules that are not there.
    """

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Skip what imports a module of a missing plug-in, or of its tests; find nothing else."""
        if (found := OF_PLUGIN.fullmatch(name)) and missing(found[1]):
            pytest.skip(_reason(found[1]), allow_module_level=True)
        return None


def watch_imports() -> None:
    """Let imports say which plug-ins tests need."""
    sys.meta_path.append(MissingPlugins())


def installed(*commands: Sequence[str]) -> list[Sequence[str]]:
    """Return those of some commands, each with its words, that are there: plug-ins may be missing."""

    def is_file(words: Sequence[str]) -> bool:
        name, *rest = (word for word in words if not word.startswith("-"))
        return " ".join((name, *rest[:1]) if name == "export" else (name,)) in plugins().commands

    return [*filter(is_file, commands)]


def is_of_installed(path: str) -> bool:
    """Return whether a file of the project, by its path in it, is there as far as plug-ins decide it."""
    found = re.match(r"(?:pipeline|tests)/plugins/(\w+)(?:/|$)", path)
    return found is None or not missing(found[1])


def needed_by(*shots: Path) -> list[str]:
    """Return the plug-ins that shots of the gallery say in their first lines that they need."""
    said = (NEEDS.match(shot.read_text(encoding="utf-8")) for shot in shots)
    return sorted({name for found in said if found for name in re.split(", | and ", found[1])})


def needed_by_gallery() -> list[str]:
    """Return the plug-ins that any shot of the gallery needs."""
    return needed_by(*GALLERY.glob("*.yaml"))


def gallery_rows(paths: Iterable[Path]) -> list[ParameterSet]:
    """Return rows of a table of the gallery's files, each skipped where a plug-in that it needs is missing.

    Edits need what all shots need, except the film.
    """
    return [
        pytest.param(
            path,
            marks=needs_plugins(*(needed_by_gallery() if path.stem == "showreel" else needed_by(path))),
            id=path.stem,
        )
        for path in paths
    ]


def needed_in(text: str) -> list[str]:
    """Return the plug-ins that a part of a shot file, or of a command, needs.

    They are those that add its names and suffixes, and those that shots of the gallery need which it names.
    """
    owners = {name: plugin for plugin, names in ADDED.items() for name in names}
    words = re.findall(r"[\w.]+", text)
    found = {owners.get(word) or owners.get(f".{word.rpartition('.')[2]}", "") for word in words}
    found |= {*SHIPPED} & {word.partition(".")[0] for word in words if "." in word}
    found |= {*SHIPPED} & {*re.findall(r"^(\w+):", text, flags=re.M)}  # entries of plug-ins
    shots = (shot for shot in GALLERY.glob("*.yaml") if shot.stem in words)
    return sorted(found.union(needed_by(*shots)) - {""})


def shot_rows(rows: Iterable[object]) -> list[ParameterSet]:
    """Return rows of a table with parts of shot files, each skipped where its plug-ins are missing."""
    values = (row if isinstance(row, tuple) else (row,) for row in rows)
    return [pytest.param(*row, marks=needs_plugins(*needed_in(" ".join(map(str, row))))) for row in values]
