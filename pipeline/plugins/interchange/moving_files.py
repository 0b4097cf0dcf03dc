"""Moving surfaces of files: what a process that reads one answers, and the `MovingSurface` that asks it.

The process opens the file once, and answers about one time after another. Where the faces stay the same, it
sends them once.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from flowsculpt import MeshError, MissingInputError
from flowsculpt.api import shorten, suggest
from flowsculpt.api.files import CachedAnswer, Parser
from flowsculpt.api.meshes import FileSurface, Floats, SourceFiles
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    answered,
    content_of,
    packed_arrays,
    packed_surface,
    unpacked_surface,
)

LARGEST_CACHE = 8 << 30
"""Size of the largest file that is read sample by sample, bytes: the largest that is read at all."""

_VERSION = "1"  # goes up when the processes answer otherwise about the same files


class MotionFacts(NamedTuple):
    """The facts of a moving surface, as `MovingSurface` has them."""

    times: Floats
    rate: float | None
    is_fixed: bool
    is_continuous: bool


class MotionSource(Protocol):
    """An open file, in the process that reads it."""

    @property
    def motion(self) -> MotionFacts:
        """The facts. Raises MeshError where nothing moves."""

    def surface(self, seconds: float) -> FileSurface:
        """Return the polygons at a time. Raises MeshError or ValueError."""


def answer_about(begin: Callable[[], MotionSource]) -> Callable[[str], bytes]:
    """Return what answers the questions of a `MovingFile`; `begin` opens the file at the first.

    `facts` are its MotionFacts, `sample` a surface, `surface` and `points` are those of a motion with fixed
    faces.
    """
    opened = cache(begin)
    first = cache(lambda: opened().surface(opened().motion.times[0]))

    def content(kind: str, seconds: float) -> bytes:
        if kind == "facts":
            times, *facts = opened().motion
            return json.dumps([times.tolist(), *facts]).encode()
        surface = opened().surface(seconds)
        if kind != "sample":
            _require_same_faces(surface, first())
        return _sample(surface, kind == "points")

    return lambda question: answered(lambda: content(*json.loads(question)))


def _require_same_faces(surface: FileSurface, first: FileSurface) -> None:
    """Raise MeshError where a surface has other faces than the first; a mirror turns them over."""
    if len(surface.points) != len(first.points):
        raise MeshError(f"it has {len(surface.points)} vertices, and {len(first.points)} at its first time")
    if not np.array_equal(surface.corners, first.corners):
        raise MeshError("it has other faces than at its first time, or a scale mirrors it from then on")


def _sample(surface: FileSurface, points_alone: bool) -> bytes:
    values = {"points": surface.points, "velocities": surface.velocities, "normals": surface.normals}
    given: dict[str, Any] = {name: rows for name, rows in values.items() if rows is not None}
    is_finite = np.all([np.isfinite(given[name]).all(axis=1) for name in {*given} - {"normals"}], axis=0)
    if not is_finite[surface.corners].all():
        vertex = int(surface.corners[np.argmin(is_finite[surface.corners])])
        raise MeshError(f"vertex {vertex} is {surface.points[vertex].tolist()}, which is not finite")
    if not points_alone:
        return packed_surface(surface)
    return packed_arrays(given)


@dataclass
class MovingFile:
    """The `MovingSurface` of a file.

    module   the module whose process reads it, by `Parser.serve_session`
    options  of the session
    samples  that a process reads before another takes its place; 0 for any number
    """

    path: Path
    module: str
    options: Sequence[str]
    files: SourceFiles
    samples: int = 0
    times: Floats = field(init=False)
    rate: float | None = field(init=False)
    is_fixed: bool = field(init=False)
    is_continuous: bool = field(init=False)
    is_in_frames: bool = False
    _session: Any = None
    _first: FileSurface | None = None
    _state: object = None
    _asked: int = 0

    @classmethod
    def opened(
        cls, path: Path, module: str, files: SourceFiles, library: str, *options: str, samples: int = 0
    ) -> MovingFile:
        """Open a file; the disk cache stores its facts by the contents of its files.

        library  the package that reads it; another version is asked again

        Raises MeshError, ValueError or MissingInputError where it cannot be read.
        """
        moving = cls(path, module, options, files, samples)
        moving._state = state_of(files)
        known = CachedAnswer.of(
            "parsed", ["motion", _VERSION, module, version(library), files.digest, *options]
        )
        motion = known.load(lambda it: _motion_of(it["facts"]))
        if motion is None:
            facts = json.loads(moving._ask("facts", 0.0))
            known.store({"facts": facts})
            motion = _motion_of(facts)
            moving.close()
        moving.times, moving.rate, moving.is_fixed, moving.is_continuous = motion
        return moving

    def at(self, seconds: float) -> FileSurface:
        seconds = float(np.clip(seconds, self.times[0], self.times[-1]))
        try:
            if not self.is_fixed:
                return unpacked_surface(self._ask("sample", seconds))
            if self._first is None:
                self._first = unpacked_surface(self._ask("surface", seconds))
                return self._first
            rows = np.load(io.BytesIO(self._ask("points", seconds)), allow_pickle=False)
        except MissingInputError:
            raise
        except (MeshError, ValueError) as error:
            raise MeshError(f"{self.path}: at {seconds:.6g} s: {error}. Export it again.") from None
        return self._first._replace(**{"velocities": None, "normals": None, **rows})

    def close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None

    def _ask(self, kind: str, seconds: float) -> bytes:
        self._asked += 1
        if self.samples and self._asked % self.samples == 0:
            self.close()
        if self._session is None:
            self._session = Parser(self.module).session(self.path, *self.options)
        try:
            content = content_of(self._session.ask(json.dumps([kind, seconds])), self.path)
        except (MeshError, ValueError):
            self.close()
            self._require_unchanged()
            raise
        self._require_unchanged()
        return content

    def _require_unchanged(self) -> None:
        if state_of(self.files) != self._state:
            raise MissingInputError(
                f"{self.path}: it changed, or a file that it names, while it was read; run again"
            )


def state_of(files: SourceFiles) -> object:
    """Return what differs when one of some files is changed or replaced, without reading any."""
    states: list[tuple[int, int, int] | None] = []
    for file, _ in files.files:
        states.append(None)
        with suppress(OSError):
            facts = file.stat()
            states[-1] = facts.st_size, facts.st_mtime_ns, facts.st_ino
    return states


def first_sample(path: Path, module: str, *options: str) -> FileSurface:
    """Return the first sample of a file, even if nothing moves in it. Raises as `MovingFile.opened`."""
    session = Parser(module).session(path, *options)
    try:
        return unpacked_surface(content_of(session.ask(json.dumps(["sample", -_NEVER])), path))
    finally:
        session.close()


_NEVER = 1e12  # seconds


def _motion_of(facts: list[Any]) -> MotionFacts:
    times, rate, is_fixed, is_continuous = facts
    return MotionFacts(np.array(times, np.float64), rate, is_fixed, is_continuous)


def chosen_animation(name: str, found: Collection[str]) -> str:
    """Return the animation of a file that is asked for: with an empty name the first that it has.

    Raises MeshError where there is none of that name.
    """
    if name and name not in found:
        remedy = suggest(name, found) if found else "Nothing in it moves."
        raise MeshError(f"it has no animation {shorten(repr(name))}. {remedy}")
    return name or next(iter(found), "")


def several_animations(found: Collection[str]) -> MeshError:
    """Return the error of a file with several animations of which none is named."""
    names, first = shorten(", ".join(found)), shorten(next(iter(found)))
    return MeshError(f"it has several animations: {names}. Write animation: {first}, or another.")


def require_times(times: Floats, remedy: str) -> Floats:
    """Return times (T,). Raises MeshError where they are none, not finite, or do not ascend."""
    if not len(times):
        raise MeshError(f"nothing moves in it. {remedy}")
    if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        raise MeshError("its times do not ascend. Export it again.")
    return times
