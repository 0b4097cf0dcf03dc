"""Surfaces of a shot for previews: the normals of a frame are computed while the next is simulated."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from types import TracebackType

from pipeline.animation import MeshFrame
from pipeline.arrays import AnyArray
from pipeline.dailies.preview.mesh_source import MeshCache, MeshSource, stored
from pipeline.dailies.preview.spill_cache import SpillCache
from pipeline.errors import FrameError
from pipeline.mesh.pn_triangles import MOST_PIECES
from pipeline.production.render_inputs.motion import speeds
from pipeline.production.render_inputs.shading import Shading
from pipeline.production.request.keys import speed_data, thresholds_at
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import Key, Store, key_of
from render.scene.measure import SPEED

UNSHADED = 4
"""Frames that may wait for normals while others are simulated."""

DICED = 100_000
"""Vertices, about, of a previewed surface that renders dice."""


@dataclass(eq=False)
class SurfaceStream:
    """Surfaces of a shot, kept from one preview to the next; a context manager.

    store     where renders keep meshes and normals
    once      True if no other preview follows: forget frames once they are drawn, and remember no mesh
    meshes    mesh frames from which a simulation can resume
    surfaces  arrays of the frames that are not drawn yet

    After an edit, surfaces that are still valid are reused.
    """

    store: Store
    once: bool = False
    meshes: MeshCache = field(init=False)
    surfaces: SpillCache = field(default_factory=SpillCache)

    def __post_init__(self) -> None:
        self.meshes = MeshCache(room=0.0) if self.once else MeshCache()

    def __enter__(self) -> SurfaceStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.surfaces.close()

    def play(self, request: RenderRequest, numbers: Iterable[int]) -> Iterator[int]:
        """Compute the surfaces of frames in ascending order, and yield each number when its surface is there.

        Raises FrameError where the flow or the resampling fails, after all frames before it.
        """
        frames = request.shot.motion.frames
        self.surfaces.keep_only({_key(request, n) for n in frames})
        self.meshes.keep_only({request.mesh_key(n) for n in frames})
        with ThreadPoolExecutor(1) as pool:
            under_way: deque[tuple[int, Future[None]]] = deque()
            failed = None
            try:
                for number, made in self._submitted(request, sorted(numbers), pool):
                    under_way.append((number, made))
                    while len(under_way) > UNSHADED or (under_way and under_way[0][1].done()):
                        yield _finished(*under_way.popleft())
            except FrameError as error:
                failed = error
            while under_way:
                yield _finished(*under_way.popleft())
            if failed is not None:
                raise failed

    def arrays(self, request: RenderRequest, number: int) -> dict[str, AnyArray]:
        """Return the arrays of a frame that was played."""
        return dict(self.surfaces.get(_key(request, number)))

    def drawn(self, request: RenderRequest, number: int) -> None:
        """Note that a frame is drawn; forget it unless another preview follows."""
        if self.once:
            self.surfaces.drop(_key(request, number))

    def _submitted(
        self, request: RenderRequest, numbers: list[int], pool: ThreadPoolExecutor
    ) -> Iterator[tuple[int, Future[None]]]:
        meshes = MeshSource(request, self.store, self.meshes)
        for number in numbers:
            if _key(request, number) in self.surfaces:
                made = pool.submit(_nothing)
            elif self.store.holds("normals", request.normals_key(number)) and not _needs_mesh(request):
                made = pool.submit(self._read, request, number)
            else:
                made = pool.submit(self._shade, request, meshes.at(number))
            yield number, made

    def _read(self, request: RenderRequest, number: int) -> None:
        read = readers.arrays(request.normals_key(number))
        self.surfaces.put(_key(request, number), stored(request, self.store, "normals", number, read))

    def _shade(self, request: RenderRequest, frame: MeshFrame) -> None:
        shading = Shading.of(frame, thresholds_at(request.shot.motion, frame.number), _pieces(request, frame))
        arrays = shading.arrays()
        if request.measures_speed:
            arrays[SPEED] = speeds(request.shot.motion, shading)
        self.surfaces.put(_key(request, frame.number), arrays)


def _key(request: RenderRequest, number: int) -> Key:
    """The key of a previewed frame: its normals, and speeds where colours show them."""
    measured = speed_data(request, number)
    return key_of(request.normals_key(number), measured) if measured else request.normals_key(number)


def _needs_mesh(request: RenderRequest) -> bool:
    """Tell whether a preview draws more than the stored normals hold."""
    return request.measures_speed or request.shot.picture.dicing is not None


def _pieces(request: RenderRequest, frame: MeshFrame) -> int:
    """Return the number of pieces of each edge.

    Renders dice by the size in the picture. Previews do not wait for cameras, and use a fixed number of
    vertices, which patterns need.
    """
    picture = request.shot.picture
    if picture.dicing is None:
        return picture.tessellate
    return max(1, min(MOST_PIECES, math.isqrt(DICED // max(1, len(frame.mesh.vertices)))))


def _nothing() -> None:
    """Do nothing: the surface is there already."""


def _finished(number: int, made: Future[None]) -> int:
    made.result()
    return number
