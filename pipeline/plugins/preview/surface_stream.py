"""Surfaces of a shot for previews: the normals of a frame are computed while the next is simulated.

Mesh frames come from memory, from the store, or are simulated, and are then not stored: a render simulates
them again in less time than writing them takes. Frames that took longer than SLOW are stored, and a render
reuses them.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
import psutil

from flowsculpt import FrameError
from flowsculpt.api.files import atomic_write, disk_errors
from flowsculpt.api.frames import MeshFrame, RenderRequest, Shading, Store, StoredFiles, animate, key_of
from flowsculpt.api.materials import Surface

SLOW = 0.25  # seconds, and CPU seconds, from which on a simulated frame is stored

MEMORY_SHARE = 0.2  # fraction of the free memory that mesh frames may take, and that surfaces may take

UNSHADED, LARGE_BYTES = 4, 1 << 24
"""Frames that may wait for normals while others are simulated, and the size from which on only one may."""

MOST_DICED_PIECES = 16
"""Pieces into which an edge is cut at most."""

DICED = 100_000  # vertices, about, of a previewed surface that renders dice

T = TypeVar("T")

Arrays = Mapping[str, np.ndarray]


@dataclass(eq=False)
class MeshCache:
    """Mesh frames by key, from which a simulation can resume; `room` is the memory left, in bytes."""

    room: float = field(default_factory=lambda: MEMORY_SHARE * psutil.virtual_memory().available)
    frames: dict[str, MeshFrame] = field(default_factory=dict)

    def remember(self, key: str, frame: MeshFrame) -> None:
        """Keep a frame if there is room for it."""
        if _size(frame) <= self.room:
            self.room -= _size(frame)
            self.frames[key] = frame

    def keep_only(self, keys: set[str]) -> None:
        """Forget all frames but those of these keys."""
        for key in self.frames.keys() - keys:
            self.room += _size(self.frames.pop(key))


@dataclass(eq=False)
class MeshSource:
    """The mesh frames of one shot, read in ascending order; `callback` hears of progress within a frame."""

    request: RenderRequest
    store: Store
    cache: MeshCache
    callback: Callable[..., None]
    _simulation: Iterator[MeshFrame] | None = None

    def at(self, number: int) -> MeshFrame:
        """Return a mesh frame. Raises FrameError where the flow or the resampling fails."""
        known = self._known(number)
        if known is not None:
            self._simulation = None
            return known
        if self._is_given:
            return next(animate(self.request.shot, progress=self.callback, only={number}))
        if self._simulation is None:
            first = self.request.shot.motion.frames.first
            earlier = (self._known(n) for n in range(number - 1, first - 1, -1))
            latest = next((frame for frame in earlier if frame is not None), None)
            self._simulation = animate(self.request.shot, latest, progress=self.callback)
        while True:
            wall, cpu = time.perf_counter(), time.process_time()  # flows move points in threads
            frame = next(self._simulation)
            self._keep(frame, min(time.perf_counter() - wall, time.process_time() - cpu))
            if frame.number == number:
                return frame

    @property
    def _is_given(self) -> bool:
        """True if files, or seeds, give each frame by itself: no other one has to be simulated."""
        motion = self.request.shot.motion
        return motion.animated is not None and motion.resampling is None

    def _known(self, number: int) -> MeshFrame | None:
        key = self.request.keys.mesh(number)
        if key in self.cache.frames:
            return replace(self.cache.frames[key], number=number)  # frames of the shot may have moved
        if self.store.bring("mesh", key):
            with suppress(FrameError):  # a damaged file is evicted, and the frame simulated again
                place = self.request.place("mesh", number)
                known: MeshFrame = self.store.read(
                    "mesh", key, place, StoredFiles("mesh").reader(key, number=number)
                )
                return known
        return None

    def _keep(self, frame: MeshFrame, seconds: float) -> None:
        key = self.request.keys.mesh(frame.number)
        self.cache.remember(key, frame)
        if seconds > SLOW:
            self.store.put("mesh", key, StoredFiles.writer(key, frame.to_arrays()))


def _size(frame: MeshFrame) -> int:
    attributes = sum(values.nbytes for values in frame.own.attributes.values())
    return int(frame.own.vertices.nbytes + frame.own.faces.nbytes + attributes)


class SpillCache:
    """Arrays by key: in memory up to `room` bytes, then in temporary files until `close`."""

    def __init__(self, room: float | None = None) -> None:
        self._room = MEMORY_SHARE * psutil.virtual_memory().available if room is None else room
        self._held: dict[str, Arrays] = {}
        self._counting = Lock()
        with disk_errors(Path(tempfile.gettempdir())):
            self._folder = tempfile.TemporaryDirectory(prefix="flowsculpt-")

    def close(self) -> None:
        self._held.clear()
        self._folder.cleanup()

    def __contains__(self, key: str) -> bool:
        return key in self._held or self._file(key).exists()

    def put(self, key: str, arrays: Arrays) -> None:
        """Keep arrays under a key. Raises MachineError if neither memory nor disk has room."""
        size = sum(values.nbytes for values in arrays.values())
        with self._counting:
            fits = size <= self._room
            self._room -= size if fits else 0
        if fits:
            self._held[key] = arrays
        else:
            named: dict[str, Any] = dict(arrays)
            with atomic_write(self._file(key), flush=False) as draft, draft.open("wb") as file:
                np.savez(file, **named)

    def get(self, key: str) -> Arrays:
        if key in self._held:
            return self._held[key]
        with self._file(key).open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)

    def drop(self, key: str) -> None:
        """Forget the arrays of a key."""
        with self._counting:
            self._room += sum(values.nbytes for values in self._held.pop(key, {}).values())
        self._file(key).unlink(missing_ok=True)

    def keep_only(self, keys: set[str]) -> None:
        """Forget all arrays but those of these keys."""
        for key in {*self._held, *(file.stem for file in Path(self._folder.name).iterdir())} - keys:
            self.drop(key)

    def _file(self, key: str) -> Path:
        return Path(self._folder.name) / f"{key}.npz"


def in_order(submitted: Iterator[tuple[int, Future[T]]], most: Callable[[], int]) -> Iterator[tuple[int, T]]:
    """Yield numbers and results in the order in which they are submitted; `most` returns how many may wait.

    Where submitting raises FrameError, those before it are yielded first.
    """
    under_way: deque[tuple[int, Future[T]]] = deque()
    failure = None
    while True:
        try:
            under_way.append(next(submitted))
        except StopIteration:
            break
        except FrameError as error:
            failure = error
            break
        while under_way and (under_way[0][1].done() or len(under_way) > most()):
            number, future = under_way.popleft()
            yield number, future.result()
    yield from ((number, future.result()) for number, future in under_way)
    if failure is not None:
        raise failure


@dataclass(eq=False)
class SurfaceStream:
    """Surfaces of a shot, kept from one preview to the next; a context manager.

    store     where renders keep meshes and normals
    once      True if no other preview follows: forget frames once they are drawn, and remember no mesh
    meshes    mesh frames from which a simulation can resume
    surfaces  arrays of the frames that are not drawn yet
    callback  called with the progress within a frame that takes long

    After an edit, surfaces that are still valid are reused.
    """

    store: Store
    once: bool = False
    meshes: MeshCache = field(init=False)
    surfaces: SpillCache = field(default_factory=SpillCache)
    callback: Callable[..., None] = field(default=lambda progress: None)

    def __post_init__(self) -> None:
        self._waiting = UNSHADED
        self.meshes = MeshCache(room=0.0) if self.once else MeshCache()

    def __enter__(self) -> SurfaceStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.surfaces.close()

    def play(
        self, request: RenderRequest, numbers: Iterable[int], shown: Iterable[tuple[RenderRequest, int]] = ()
    ) -> Iterator[int]:
        """Compute the surfaces of frames in ascending order, and yield each number when its surface is there.

        Keeps those of `shown`, frames of earlier requests, too. Raises FrameError where the flow or the
        resampling fails, after all frames before it.
        """
        frames, numbers = request.shot.frames, list(numbers)
        wanted = [*((request, n) for n in frames), *shown]
        self.surfaces.keep_only({_key(part, n) for each, n in wanted for part in each.parts})
        self.meshes.keep_only({part.keys.mesh(n) for part in request.parts for n in frames})
        played = [self._play(part, numbers) for part in request.parts]
        yield from played[0] if len(played) == 1 else map(min, zip(*played, strict=True))

    def _play(self, request: RenderRequest, numbers: list[int]) -> Iterator[int]:
        """Compute the surfaces of one subject, as `play` does."""
        with ThreadPoolExecutor(1) as pool:
            submitted = self._submitted(request, sorted(numbers), pool)
            yield from (number for number, _ in in_order(submitted, lambda: self._waiting))

    def knows(self, request: RenderRequest, number: int) -> bool:
        """Tell whether the surfaces of a frame are there without simulation."""
        return all(_key(part, number) in self.surfaces for part in request.parts)

    def arrays(self, request: RenderRequest, number: int) -> dict[str, np.ndarray]:
        """Return the arrays of a frame that was played, of a request of one subject."""
        return Shading.of_all_copies(self.surfaces.get(_key(request, number)))

    def each(self, request: RenderRequest, number: int) -> list[dict[str, np.ndarray]]:
        """Return the arrays of each subject of a frame that was played."""
        return [self.arrays(part, number) for part in request.parts]

    def drawn(self, request: RenderRequest, number: int) -> None:
        """Note that a frame is drawn; forget it unless another preview follows."""
        for part in request.parts if self.once else ():
            self.surfaces.drop(_key(part, number))

    def _submitted(
        self, request: RenderRequest, numbers: list[int], pool: ThreadPoolExecutor
    ) -> Iterator[tuple[int, Future[None]]]:
        meshes = MeshSource(request, self.store, self.meshes, self.callback)
        for number in numbers:
            if _key(request, number) in self.surfaces:
                surface = pool.submit(lambda: None)
            elif self.store.bring("normals", request.keys.normals(number)) and not _needs_mesh(request):
                surface = pool.submit(self._read, request, number)
            else:
                mesh = meshes.at(number)
                self._waiting = UNSHADED if _size(mesh) < LARGE_BYTES else 1
                surface = pool.submit(self._shade, request, mesh)
                del mesh
            yield number, surface

    def _read(self, request: RenderRequest, number: int) -> None:
        key, place = request.keys.normals(number), request.place("normals", number)
        self.surfaces.put(
            _key(request, number), self.store.read("normals", key, place, StoredFiles("normals").reader(key))
        )

    def _shade(self, request: RenderRequest, frame: MeshFrame) -> None:
        shading = Shading.of(
            frame, request.shot.motion.thresholds_at(frame.number), pieces_of(request, frame)
        )
        arrays = shading.stored()
        if request.pictures.measures_speed:
            arrays[Surface.SPEED] = shading.speeds(request.shot.motion)
        self.surfaces.put(_key(request, frame.number), arrays)


def _key(request: RenderRequest, number: int) -> str:
    """The key of a previewed frame: its normals, and speeds where colours show them."""
    speeds_from = request.keys.speed_data(number)
    return key_of(request.keys.normals(number), speeds_from) if speeds_from else request.keys.normals(number)


def _needs_mesh(request: RenderRequest) -> bool:
    """Tell whether a preview draws more than the stored normals hold."""
    return request.pictures.measures_speed or request.shot.picture.dicing is not None


def pieces_of(request: RenderRequest, frame: MeshFrame) -> int:
    """Return the number of pieces of each edge.

    Renders dice by the size in the picture. Previews do not wait for cameras, and use a fixed number of
    vertices, which patterns need.
    """
    picture = request.shot.picture
    if picture.dicing is None:
        return picture.tessellate
    return max(1, min(MOST_DICED_PIECES, math.isqrt(DICED // max(1, len(frame.mesh.vertices)))))
