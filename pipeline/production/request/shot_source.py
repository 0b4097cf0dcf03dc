"""The source of a shot: its file and all that it rests on, as they were when the work was planned."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FlowsculptError, MissingInputError, UsageError
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.request.shot_summary import (
    InputDigests,
    ShotSummary,
    can_be_cached,
    input_digests,
    require_same,
    require_unchanged,
)
from pipeline.shot.yaml.lookup import DEFAULTS
from render.base.serialise import NOT_PLAIN, from_plain, to_plain

if TYPE_CHECKING:
    from pipeline.shot import Shot


@dataclass(frozen=True)
class ShotSource:
    """Everything that a shot is read from, the same in every process.

    text, path  the shot file, and where it lies
    settings    values that replace those of the file: `flows.0.vortex.strength=2`
    beside      names and texts of the shot files that it rests on
    allow_code  whether the shot may run the Python files that it names
    inputs      digests of the other files that it reads; None before the work is planned
    cache       holds its summary; no part of what it is read from
    """

    text: str
    path: Path
    settings: tuple[str, ...] = ()
    beside: tuple[tuple[str, str], ...] = ()
    allow_code: bool = False
    inputs: InputDigests | None = None
    cache: PlanningCache | None = field(default=None, compare=False, repr=False, metadata=NOT_PLAIN)

    @property
    def name(self) -> str:
        """The shot's name, known without reading it."""
        return self.path.stem

    @cached_property
    def shot(self) -> Shot:
        """The shot. Raises UsageError where a file that it reads was changed since the work was planned."""
        from pipeline.shot import read_shot

        try:
            shot = read_shot(self.path, self.text, self.settings, dict(self.beside), self.allow_code)
        except FlowsculptError:
            require_unchanged(self.inputs or ())  # a changed file is the cause then
            raise
        if self.inputs is not None:
            require_same(self.inputs, input_digests(shot.files))
        return shot

    def with_inputs(self) -> ShotSource:
        """Return the source with the digests of the files that its shot reads."""
        source = replace(self, inputs=self.summary.inputs)
        vars(source).update({name: vars(self)[name] for name in ("summary", "shot") if name in vars(self)})
        return source

    @cached_property
    def summary(self) -> ShotSummary:
        """The summary for planning; the shot is read only where the cache does not hold it.

        Raises what `shot` raises.
        """
        known = self._cached_summary()
        if known is not None:
            return known
        summary = ShotSummary.of(self.shot)
        if self.cache is not None and can_be_cached(self.shot):
            self.cache.put(to_plain(summary), *self._read_from)
        return summary

    def _cached_summary(self) -> ShotSummary | None:
        """None too where a file was changed since, or is not the one that the work was planned for: then the
        shot is read, and its errors are told."""
        data = None if self.cache is None else self.cache.get(*self._read_from)
        if data is None:
            return None
        known = from_plain(ShotSummary, data)
        return known if self.inputs in (None, known.inputs) and known.is_current else None

    @property
    def _read_from(self) -> tuple[Any, ...]:
        """All but the other files, which only reading the shot tells."""
        return "summary", self.text, str(self.path), self.settings, self.beside, self.allow_code


@dataclass(frozen=True)
class SourceCache:
    """Shot files and those that they rest on, each read once: edits during a run do not reach it."""

    _texts: dict[Path, str] = field(default_factory=dict)
    _beside: dict[Path, dict[str, str]] = field(default_factory=dict)

    def source(self, path: Path, settings: tuple[str, ...], allow_code: bool) -> ShotSource:
        """Return the source of the shot file at an absolute path. Raises MissingInputError or UsageError."""
        text = self._texts.get(path) or self._texts.setdefault(path, _text(path))
        beside = self._beside.get(path) or self._beside.setdefault(path, _rests_on(path, text))
        return ShotSource(text, path, settings, tuple(beside.items()), allow_code)

    def put(self, path: Path, text: str) -> None:
        """Use `text` as the content of the file at `path`."""
        self._texts[path] = text


def shot_around(mesh: Path) -> str:
    """Return the text of a shot that shows a mesh file as it is. Raises MissingInputError."""
    if not mesh.is_file():
        raise MissingInputError(f"{mesh}: no such mesh file; check the path")
    shot = {
        "title": mesh.stem,
        "frames": "1-1",
        "subject": {"model": str(mesh.absolute())},
        "resample": "off",
    }
    return json.dumps(shot, ensure_ascii=False)  # JSON is YAML, quotes and all


def _rests_on(path: Path, text: str) -> dict[str, str]:
    """Return names and texts of the other files that a shot is made of; most shots extend none."""
    if "extends" in text:
        from pipeline.shot.yaml.inheritance import inherited_files

        return inherited_files(path, text)
    defaults = path.with_name(DEFAULTS)
    try:
        return {DEFAULTS: defaults.read_text(encoding="utf-8")}
    except (OSError, UnicodeDecodeError):
        return {}


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingInputError(f"{path}: no such shot file; flowsculpt new makes one") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise MissingInputError(f"{path}: cannot be read ({error.strerror})") from None
