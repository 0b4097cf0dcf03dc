"""Mesh frames of a shot in ascending order, each from where it is had soonest: memory, the store, simulation.

A quick look leaves no meshes behind: simulating them again for a render takes less than writing and keeping
them. Frames that took longer than SLOW are kept in the store all the same, for a render finds them there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import psutil

from pipeline.animation import MeshFrame, animate
from pipeline.errors import FrameError
from pipeline.production.keys.digest import Key
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.readers import write_npz
from pipeline.production.store.store import Store

SLOW = 0.25
"""Seconds of a core from which on a frame is kept in the store."""

SHARE = 0.2
"""Of the memory that is free, how much remembered frames may take."""


@dataclass(eq=False)
class MeshCache:
    """Mesh frames to go on from, by key: as many as there is room for, in bytes."""

    room: float = field(default_factory=lambda: SHARE * psutil.virtual_memory().available)
    frames: dict[Key, MeshFrame] = field(default_factory=dict)

    def remember(self, key: Key, frame: MeshFrame) -> None:
        if _size(frame) <= self.room:
            self.room -= _size(frame)
            self.frames[key] = frame

    def keep_only(self, keys: set[Key]) -> None:
        """Forget all others."""
        for key in self.frames.keys() - keys:
            self.room += _size(self.frames.pop(key))


@dataclass(eq=False)
class MeshSource:
    """Those of one take. To be asked for in ascending order."""

    request: RenderRequest
    store: Store
    memory: MeshCache
    _coming: Iterator[MeshFrame] | None = None

    def at(self, number: int) -> MeshFrame:
        """Raises FrameError where the flow or the resampling fails."""
        found = self._known(number)
        if found is not None:
            self._coming = None
            return found
        if self._coming is None:
            self._coming = animate(self.request.shot, resume=self._before(number))
        while True:
            started = time.thread_time()
            frame = next(self._coming)
            self._keep(frame, time.thread_time() - started)
            if frame.number == number:
                return frame

    def _known(self, number: int) -> MeshFrame | None:
        key = self.request.mesh_key(number)
        if key in self.memory.frames:
            return self.memory.frames[key]
        if self.store.holds("mesh", key):
            with suppress(FrameError):  # it is forgotten then, and simulated again
                return stored(self.request, self.store, "mesh", number, readers.mesh_frame(key))
        return None

    def _before(self, number: int) -> MeshFrame | None:
        """The latest frame before it that is known."""
        first = self.request.shot.motion.frames.first
        known = (self._known(earlier) for earlier in range(number - 1, first - 1, -1))
        return next((frame for frame in known if frame is not None), None)

    def _keep(self, frame: MeshFrame, seconds: float) -> None:
        key = self.request.mesh_key(frame.number)
        self.memory.remember(key, frame)
        if seconds > SLOW:
            arrays = readers.with_key(key, frame.to_arrays())
            self.store.put("mesh", key, partial(write_npz, named=arrays))


def _size(frame: MeshFrame) -> int:
    attributes = sum(values.nbytes for values in frame.mesh.attributes.values())
    return int(frame.mesh.vertices.nbytes + frame.mesh.faces.nbytes + attributes)


T = TypeVar("T")


def stored(request: RenderRequest, store: Store, kind: str, number: int, reader: Callable[[Path], T]) -> T:
    """Read the `mesh` or the `normals` of a frame. Raises FrameError where the file is damaged."""
    key = request.mesh_key(number) if kind == "mesh" else request.normals_key(number)
    return store.read(kind, key, request.place(kind, number), reader)
