"""The surfaces of a shot as they are drawn; normals of a frame are found while the next is simulated."""

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
from pipeline.production.keys.digest import Key, key_of
from pipeline.production.render_inputs.motion import speeds
from pipeline.production.render_inputs.shading import Shading
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import Store
from render.scene.measure import SPEED

UNSHADED = 4
"""Frames whose normals may be found while others are simulated."""

DICED = 100_000
"""About as many vertices a surface is cut into where renders dice it."""


@dataclass(eq=False)
class SurfaceStream:
    """What is known of a shot's surfaces from one look to the next; a context manager.

    After an edit what it left valid is known still. Where nobody will look again, each frame is forgotten
    when it has been drawn, and no mesh is remembered.
    """

    store: Store
    once: bool = False
    memory: MeshCache = field(init=False)
    shelf: SpillCache = field(default_factory=SpillCache)

    def __post_init__(self) -> None:
        self.memory = MeshCache(room=0.0) if self.once else MeshCache()

    def __enter__(self) -> SurfaceStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shelf.close()

    def play(self, request: RenderRequest, numbers: Iterable[int]) -> Iterator[int]:
        """Find the surfaces of frames, in ascending order; each number when it is there.

        Raises FrameError where the flow or the resampling fails; the frames before it have come.
        """
        frames = request.shot.motion.frames
        self.shelf.keep_only({_key(request, n) for n in frames})
        self.memory.keep_only({request.mesh_key(n) for n in frames})
        with ThreadPoolExecutor(1) as pool:
            under_way: deque[tuple[int, Future[None]]] = deque()
            failed = None
            try:
                for number, made in self._begun(request, sorted(numbers), pool):
                    under_way.append((number, made))
                    while len(under_way) > UNSHADED or (under_way and under_way[0][1].done()):
                        yield _done(*under_way.popleft())
            except FrameError as error:
                failed = error
            while under_way:
                yield _done(*under_way.popleft())
            if failed is not None:
                raise failed

    def arrays(self, request: RenderRequest, number: int) -> dict[str, AnyArray]:
        """What is drawn of a frame that was played."""
        return dict(self.shelf.get(_key(request, number)))

    def drawn(self, request: RenderRequest, number: int) -> None:
        """A frame will not be asked for any more, unless somebody looks again."""
        if self.once:
            self.shelf.drop(_key(request, number))

    def _begun(
        self, request: RenderRequest, numbers: list[int], pool: ThreadPoolExecutor
    ) -> Iterator[tuple[int, Future[None]]]:
        meshes = MeshSource(request, self.store, self.memory)
        for number in numbers:
            if _key(request, number) in self.shelf:
                made = pool.submit(_nothing)
            elif self.store.holds("normals", request.normals_key(number)) and not _needs_mesh(request):
                made = pool.submit(self._take_out, request, number)
            else:
                made = pool.submit(self._shade, request, meshes.at(number))
            yield number, made

    def _take_out(self, request: RenderRequest, number: int) -> None:
        read = readers.arrays(request.normals_key(number))
        self.shelf.put(_key(request, number), stored(request, self.store, "normals", number, read))

    def _shade(self, request: RenderRequest, frame: MeshFrame) -> None:
        shading = Shading.of(frame, request.thresholds(frame.number), _pieces(request, frame))
        arrays = shading.arrays()
        if request.measures_speed:
            arrays[SPEED] = speeds(request.shot.motion, shading)
        self.shelf.put(_key(request, frame.number), arrays)


def _key(request: RenderRequest, number: int) -> Key:
    """Of what is drawn of a frame: its normals, and speeds where colours show them."""
    measured = request.speed_data(number)
    return key_of(request.normals_key(number), measured) if measured else request.normals_key(number)


def _needs_mesh(request: RenderRequest) -> bool:
    """Whether normals that are kept do not say all that is drawn."""
    return request.measures_speed or request.shot.picture.dicing is not None


def _pieces(request: RenderRequest, frame: MeshFrame) -> int:
    """Into how many edges are cut. Renders that dice go by the picture; a quick look does not wait for it,
    but patterns have to be found somewhere."""
    picture = request.shot.picture
    if picture.dicing is None:
        return picture.tessellate
    return max(1, min(MOST_PIECES, math.isqrt(DICED // max(1, len(frame.mesh.vertices)))))


def _nothing() -> None:
    """It is there already."""


def _done(number: int, made: Future[None]) -> int:
    made.result()
    return number
