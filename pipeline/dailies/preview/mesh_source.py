"""Mesh frames for previews, in ascending order: from memory, from the store, or simulated.

Simulated meshes are not stored: a render simulates them again in less time than writing them takes. Frames
that took longer than SLOW are stored, and a render reuses them.
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

from pipeline.animation import FrameProgressCallback, MeshFrame, animate_reporting
from pipeline.errors import FrameError
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import Key, Store

SLOW = 0.25
"""Core-seconds from which on a simulated frame is stored."""

MEMORY_SHARE = 0.2
"""Fraction of the free memory for remembered frames."""


@dataclass(eq=False)
class MeshCache:
    """Mesh frames by key, from which a simulation can resume; `room` is the memory left, in bytes."""

    room: float = field(default_factory=lambda: MEMORY_SHARE * psutil.virtual_memory().available)
    frames: dict[Key, MeshFrame] = field(default_factory=dict)

    def remember(self, key: Key, frame: MeshFrame) -> None:
        """Keep a frame if there is room for it."""
        if _size(frame) <= self.room:
            self.room -= _size(frame)
            self.frames[key] = frame

    def keep_only(self, keys: set[Key]) -> None:
        """Forget all frames but those of these keys."""
        for key in self.frames.keys() - keys:
            self.room += _size(self.frames.pop(key))


@dataclass(eq=False)
class MeshSource:
    """The mesh frames of one shot, read in ascending order; `callback` hears of progress within a frame."""

    request: RenderRequest
    store: Store
    cache: MeshCache
    callback: FrameProgressCallback
    _simulation: Iterator[MeshFrame] | None = None

    def at(self, number: int) -> MeshFrame:
        """Return a mesh frame. Raises FrameError where the flow or the resampling fails."""
        known = self._known(number)
        if known is not None:
            self._simulation = None
            return known
        if self._simulation is None:
            self._simulation = animate_reporting(self.request.shot, self._before(number), self.callback)
        while True:
            started = time.thread_time()
            frame = next(self._simulation)
            self._keep(frame, time.thread_time() - started)
            if frame.number == number:
                return frame

    def _known(self, number: int) -> MeshFrame | None:
        key = self.request.mesh_key(number)
        if key in self.cache.frames:
            return self.cache.frames[key]
        if self.store.holds("mesh", key):
            with suppress(FrameError):  # a damaged file is evicted, and the frame simulated again
                return stored(self.request, self.store, "mesh", number, readers.mesh_frame(key))
        return None

    def _before(self, number: int) -> MeshFrame | None:
        """Return the latest known frame before `number`."""
        first = self.request.shot.motion.frames.first
        known = (self._known(earlier) for earlier in range(number - 1, first - 1, -1))
        return next((frame for frame in known if frame is not None), None)

    def _keep(self, frame: MeshFrame, seconds: float) -> None:
        key = self.request.mesh_key(frame.number)
        self.cache.remember(key, frame)
        if seconds > SLOW:
            arrays = readers.with_key(key, frame.to_arrays())
            self.store.put("mesh", key, partial(readers.write_npz, named=arrays))


def _size(frame: MeshFrame) -> int:
    attributes = sum(values.nbytes for values in frame.mesh.attributes.values())
    return int(frame.mesh.vertices.nbytes + frame.mesh.faces.nbytes + attributes)


T = TypeVar("T")


def stored(request: RenderRequest, store: Store, kind: str, number: int, reader: Callable[[Path], T]) -> T:
    """Read the `mesh` or the `normals` of a frame. Raises FrameError where the file is damaged."""
    key = request.mesh_key(number) if kind == "mesh" else request.normals_key(number)
    return store.read(kind, key, request.place(kind, number), reader)
