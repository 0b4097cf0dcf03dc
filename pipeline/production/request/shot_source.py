"""The source of a shot, as it was when the work was planned, and the planning cache of what it says.

The cache only makes planning faster and may be deleted at any time. An entry is filed under everything it was
found from: the shot's text and settings, the sources of the whole project, the versions of the packages they
use. A damaged entry, or one of another form, counts as none.

    .flowsculpt/planning/<key>.json          in a root where a run has begun: all who work in it share them
    ~/.cache/flowsculpt/planning/<key>.json  before, for commands that only look leave a root as it is
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import hashlib
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flowsculpt.pipeline.errors import FlowsculptError, MachineError, MissingInputError, UsageError
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.request.manifest import (
    InputDigests,
    ShotManifest,
    SurfaceKeys,
    changed_inputs,
    input_digests,
)
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import Store, key_of
from flowsculpt.pipeline.shot.yaml.named_files import DEFAULTS, text_of
from flowsculpt.render.base.atomic_write import atomic_write, make_folder
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.root_files import set_time
from flowsculpt.render.base.serialise import NOT_PLAIN, from_plain, to_plain
from flowsculpt.render.base.user_cache import KEPT_SECONDS, remove_unused, writable_cache

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot import Shot


Data = TypeVar("Data")

PACKAGES = ("numpy", "numba", "trimesh", "pydantic", "ruamel.yaml", "fileseq", "mitsuba", "OpenImageIO")


@dataclass(frozen=True)
class PlanningCache:
    """The planning cache of a root folder; without one it keeps nothing."""

    root: Path | None

    def get(self, kind: type[Data], *found_from: Any) -> Data | None:
        """Return the data of a dataclass that were put under `found_from`; None where there are none."""
        if self.root is None:
            return None
        name = f"{key_of(_code(), *found_from)}.json"
        for folder in (self._folder, _user_folder()):
            with contextlib.suppress(BadInputError):
                if (plain := _entry(f"{folder}/{name}")) is not None:
                    return from_plain(kind, plain)
        return None

    def put(self, data: Any, *found_from: Any) -> None:
        """File the data of a dataclass under `found_from`. Ignore errors of the disk."""
        if self.root is None:
            return
        name, text = f"{key_of(_code(), *found_from)}.json", json.dumps(to_plain(data), separators=(",", ":"))
        draft = Store(self.root).draft(".json") if self._has_begun else None
        path = Path(self._folder if self._has_begun else _pruned_user_folder(), name)
        with contextlib.suppress(OSError, MachineError), atomic_write(path, draft, flush=False) as written:
            written.write_text(f"{_digest(text)}\n{text}", encoding="utf-8")

    def found_or_made(self, kind: type[Data], make: Callable[[], Data], *found_from: Any) -> Data:
        """Return the data of a dataclass that were put under `found_from`, or make and put them there."""
        known = self.get(kind, *found_from)
        if known is not None:
            return known
        data = make()
        self.put(data, *found_from)
        return data

    @staticmethod
    def are_current(inputs: InputDigests) -> bool:
        """Tell whether files are as they were; the digest of one that was not there is empty."""
        return next(changed_inputs(inputs), None) is None

    def prune(self) -> None:
        """Remove entries that nobody used for long. Runs do this once: listing a large folder takes time."""
        remove_unused(self._folder)

    @property
    def _folder(self) -> str:
        return f"{self.root}/{STATE}/planning"

    @property
    def _has_begun(self) -> bool:
        """True if a run has begun in the root."""
        return self.root is not None and (self.root / STATE).is_dir()


NO_CACHE = PlanningCache(None)


@cache
def _code() -> list[str]:
    """Return everything besides a shot that entries may depend on: too much rather than too little."""
    return [plugins().code, *(f"{name}={version(name)}" for name in PACKAGES)]


def _entry(path: str) -> Any:
    """Return the plain data of an entry; None where it is not there, or damaged."""
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123  # Paths are slow
            digest, text = file.read().split("\n", 1)
        if digest != _digest(text):
            return None
        plain = json.loads(text)
        if time.time() - os.stat(path).st_mtime > KEPT_SECONDS / 2.0:  # noqa: PTH116
            with contextlib.suppress(OSError, MachineError):  # of a folder that is only read
                set_time(Path(path), time.time())
    except (OSError, ValueError):
        return None
    return plain


def _user_folder() -> str:
    """Return the folder of entries of roots where no run has begun."""
    return f"{writable_cache()}/planning"


@cache
def _pruned_user_folder() -> str:
    """Return the same folder without entries that nobody used for long: no run looks after it."""
    remove_unused(_user_folder())
    return _user_folder()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class ShotSource:
    """Everything that a shot is read from, the same in every process.

    text, path  the shot file, and where it lies
    settings    values that replace those of the file: `flows.0.vortex.strength=2`
    beside      names and texts of the shot files that it rests on
    allow_code  whether the shot may run the Python files that it names
    inputs      digests of the other files that it reads; None before the work is planned
    subject     the one of several subjects that it has alone; empty for all
    cache       holds its manifest; no part of what it is read from
    origin      the source that it is a copy or a part of, which reads the shot for both; no part of it either
    """

    text: str
    path: Path
    settings: tuple[str, ...] = ()
    beside: tuple[tuple[str, str], ...] = ()
    allow_code: bool = False
    inputs: InputDigests | None = None
    subject: str = ""
    cache: PlanningCache = field(default=NO_CACHE, compare=False, repr=False, metadata=NOT_PLAIN)
    origin: ShotSource | None = field(default=None, compare=False, repr=False, metadata=NOT_PLAIN)

    @property
    def name(self) -> str:
        """The shot's name, known without reading it."""
        return self.path.stem

    @cached_property
    def shot(self) -> Shot:
        """The shot. Raises UsageError where a file that it reads was changed since the work was planned."""
        try:
            whole = self._whole
        except FlowsculptError:
            if (changed := next(changed_inputs(self.inputs or ()), None)) is not None:
                raise _changed_since(changed) from None
            raise
        if self.inputs is not None and (other := set(self.inputs) ^ set(input_digests(whole.files))):
            raise _changed_since(min(other)[0])
        return whole.of_subject(self.subject) if self.subject else whole

    @cached_property
    def _whole(self) -> Shot:
        """The shot with all its subjects, which the origin reads if its text and settings are the same."""
        if self.origin is not None and self.origin._file == self._file:
            return self.origin._whole
        from flowsculpt.pipeline.shot import read_shot

        spare_modules()
        return read_shot(self.path, self.text, self.settings, dict(self.beside), self.allow_code)

    def of_subject(self, name: str) -> ShotSource:
        """Return the source of the shot with one of its subjects alone.

        What `Shot.of_subject` raises is raised once the shot is read.
        """
        return replace(self, subject=name, origin=self)

    def with_text(self, text: str) -> ShotSource:
        """Return the source of another text of the shot, which the planning cache does not keep."""
        return replace(self, text=text, inputs=None, cache=NO_CACHE)

    def with_inputs(self) -> ShotSource:
        """Return the source with the digests of the files that its shot reads."""
        return replace(self, inputs=self.manifest.inputs, origin=self)

    @cached_property
    def manifest(self) -> ShotManifest:
        """The manifest of its shot, which is read only where the cache lacks that of these files.

        Raises what `shot` raises.
        """
        origin = self.origin
        if origin and origin.read_from == self.read_from and self.inputs in (None, origin.manifest.inputs):
            return origin.manifest
        known = self.cache.get(ShotManifest, "manifest", *self.read_from)
        if known is not None and self.inputs in (None, known.inputs) and known.is_current:
            return known
        manifest = ShotManifest.of(self.shot)
        if not self.shot.picture.view.digest:  # a colour config may read tables that no digest covers
            self.cache.put(manifest, "manifest", *self.read_from)
        return manifest

    @cached_property
    def surface_keys(self) -> SurfaceKeys:
        """The keys of its surfaces. The shot is read only where the cache lacks those of these files.

        Raises what `shot` raises.
        """
        found_from = "surfaces", *self.read_from, self.manifest.inputs
        return self.cache.found_or_made(SurfaceKeys, self._surface_keys, *found_from)

    def _surface_keys(self) -> SurfaceKeys:
        """Find the keys of its surfaces from the shot."""
        subjects = self.manifest.subjects
        if not subjects:
            return SurfaceKeys.of(self.shot)
        parts = {name: self.of_subject(name).surface_keys for name in subjects}
        return SurfaceKeys.join(self.manifest.frames, parts)

    def new_notes(self) -> tuple[str, ...]:
        """Return notes on the shot's model and sounds, unless the same contents had the same notes before."""
        notes = (*(note for part in self.shot.parts for note in part.motion.subject.notes), *self.shot.notes)
        told_of = "notes on files", self.manifest.inputs, notes
        if not notes or self.cache.get(bool, *told_of):
            return ()
        if self.cache.root is not None:
            with contextlib.suppress(MachineError):
                make_folder(self.cache.root / STATE)
        self.cache.put(True, *told_of)
        return notes

    @property
    def read_from(self) -> tuple[Any, ...]:
        """All but the other files, which only reading the shot tells."""
        return (*self._file, self.subject) if self.subject else self._file

    @property
    def _file(self) -> tuple[Any, ...]:
        return self.text, str(self.path), self.settings, self.beside, self.allow_code


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


def _rests_on(path: Path, text: str) -> dict[str, str]:
    """Return names and texts of the other files that a shot is made of; most shots extend none."""
    if "extends" in text:
        from flowsculpt.pipeline.shot.yaml.inheritance import inherited_files

        return inherited_files(path, text)
    defaults = path.with_name(DEFAULTS)
    return {DEFAULTS: text_of(defaults)} if InputFile(defaults).is_there() else {}


def _text(path: Path) -> str:
    if not InputFile(path).is_there():
        raise MissingInputError(f"{path}: no such shot file; flowsculpt new makes one")
    return text_of(path)


@cache
def spare_modules() -> None:
    """Have collections of garbage look at no module that is imported by now.

    Those that read shots hold a hundred thousand containers, and planning makes so many more that each is
    looked at several times: a sixth of the time of a first plan.
    """
    gc.freeze()
    atexit.register(gc.unfreeze)  # Mitsuba complains about objects that are left when Python ends


def _changed_since(path: str) -> UsageError:
    return UsageError(f"{path}: it was changed since the work was planned; run again")
