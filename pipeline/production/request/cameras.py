"""The cameras of a request: their key, their file, and digests of what decides the camera of each picture.

The cameras of a shot share a key, which any edit of a mesh changes. Most pictures keep their camera all the
same, for it depends on frames near them. Framing a shot notes the digests of what it framed. Planning
compares them with those of today while the new cameras are not there, and so knows which cameras stay.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.production.stages import FRAME_CAMERA
from flowsculpt.pipeline.production.store.digests import CorruptFileError
from flowsculpt.pipeline.production.store.store import Key, Store, key_of
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain
from flowsculpt.render.base.state_files import mapping, read_state

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.framing import Framing
    from flowsculpt.pipeline.production.request.render_request import RenderRequest


class CameraFile(Mapping[int, "Framing"]):
    """Camera and stage of every picture of a request, by number; each is built when it is asked for.

    The file is parsed when the first is: most plans find all keys in the planning cache and need none.
    """

    def __init__(
        self, store: Store, key: Key, numbers: Collection[int], parse: Callable[[], Mapping[str, Any]]
    ) -> None:
        """Hold the cameras of the pictures `numbers`; `parse` returns the plain data of all, by number."""
        self._store, self.key, self._numbers, self._parse = store, key, numbers, parse
        self._built: dict[int, Framing] = {}

    @cached_property
    def data(self) -> Mapping[str, Any]:
        """The plain data of all, by number."""
        return self._parse()

    def __getitem__(self, number: int) -> Framing:
        """Raises FrameError where it cannot be read; the file is then evicted."""
        if number not in self._numbers:
            raise KeyError(number)
        if number not in self._built:
            from flowsculpt.pipeline.production.request.framing import Framing

            try:
                self._built[number] = from_plain(Framing, self.data[str(number)])
            except (ValueError, TypeError, AttributeError, KeyError, BadInputError) as error:
                self._store.reject("cameras", self.key)
                raise FrameError("its camera cannot be read; run again to frame the shot again") from error
        return self._built[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, number: object) -> bool:
        return number in self._numbers


def stored_framings(request: RenderRequest, store: Store) -> CameraFile | None:
    """Return camera and stage of every picture of a request; None where the store does not hold them.

    A damaged file is evicted. Raises MachineError where the disk refuses a file that the remote store has.
    """
    key, numbers = request.keys.cameras, request.angles
    path = store.path("cameras", key)
    try:
        store.bring("cameras", key)
        is_known = store.digests.check(path)
        text = path.read_text(encoding="utf-8")
        cameras = CameraFile(store, key, numbers, lambda: json.loads(text))
        if not is_known and not cameras.data.keys() >= set(map(str, numbers)):
            raise CorruptFileError(f"{path} lacks cameras")
        return cameras
    except FileNotFoundError:
        return None
    except (CorruptFileError, ValueError, AttributeError, RecursionError):
        store.discard("cameras", key)
        return None


@dataclass(frozen=True)
class FramingInputs:
    """Digests by frame.

    views   what moves the camera whatever it frames: its direction, position, target and field of view
    inputs  all that decides it, with the meshes around
    """

    views: Mapping[int, Key]
    inputs: Mapping[int, Key]

    @classmethod
    def of(cls, request: RenderRequest) -> FramingInputs:
        """Return the digests of a request; the planning cache spares reading its shot."""
        return request.source.cache.found_or_made(
            cls, lambda: cls(_views(request), _inputs(request)), "framing inputs", request.keys.identity
        )


@dataclass(frozen=True)
class _FramedFrom:
    """The key of the cameras that a request shows, and the digests of what they were framed from."""

    key: Key
    digests: FramingInputs


@dataclass(frozen=True)
class ShownCameras:
    """The cameras that a shot shows while new ones are not framed yet.

    cameras  the camera and the stage of every picture, as framed last
    settled  frames whose camera will be the same
    moved    frames whose camera will be another one
    """

    cameras: CameraFile
    settled: frozenset[int]
    moved: frozenset[int]

    @classmethod
    def of(cls, request: RenderRequest, store: Store) -> ShownCameras | None:
        """Return the cameras shown for a request; None where none are known."""
        noted = request.source.cache.get(_FramedFrom, *_place(request))
        path = request.folders.cameras()
        if noted is None or not store.shows("cameras", noted.key, path):
            return None
        data = read_state(store.root / path, mapping)
        if data is None:
            return None
        known = dict.fromkeys(number for number in request.angles if str(number) in data)
        before, now = noted.digests, FramingInputs.of(request)
        same = {n for n in known if before.inputs.get(n) == now.inputs[n]}
        return cls(
            cameras=CameraFile(store, noted.key, known, lambda: data),
            settled=frozenset(n for n in same if {n - 1, n + 1} & set(request.angles) <= same),
            moved=frozenset(n for n in known if before.views.get(n) != now.views[n]),
        )


def note_framing(request: RenderRequest) -> None:
    """Note what the cameras of a request were framed from."""
    framed = _FramedFrom(request.keys.cameras, FramingInputs.of(request))
    request.source.cache.put(framed, *_place(request))


def _place(request: RenderRequest) -> tuple[Any, ...]:
    return "framed", request.folders.cameras().as_posix()


def _views(request: RenderRequest) -> dict[int, Key]:
    """Return digests of the values of each view that framing takes as they are."""
    digests = {}
    for number in request.angles:
        view = request.pictures.view(number)
        direction = (view.azimuth + view.orbit, view.elevation) if view.position is None else view.position
        digests[number] = key_of(direction, view.target, view.roll, view.field_of_view)[:16]
    return digests


def _inputs(request: RenderRequest) -> dict[int, Key]:
    """Return digests of all that decides each camera.

    One that follows the sculpture depends on the frames near its own, others on all frames.
    """
    from flowsculpt.pipeline.production.request.framing import AHEAD

    numbers = sorted(request.angles)
    picture, pictures = request.shot.picture, request.pictures
    views = {number: pictures.view(number) for number in numbers}
    follow, move = picture.camera.follow, picture.stage.camera_move(pictures.flat_aspect)
    shared = key_of(FRAME_CAMERA.recipe, pictures.aspect, follow, request.keys.net_pieces(), move)
    if pictures.is_round:
        shared += "round"
    parts = [
        key_of(request.keys.mesh(request.angles[n].mesh), request.angles[n].spin, views[n]) for n in numbers
    ]
    if follow != 1.0 or pictures.is_round or any(view.position is not None for view in views.values()):
        return dict.fromkeys(numbers, _digest(shared, 0, parts))
    digests = {}
    for place, number in enumerate(numbers):
        first = max(0, place - AHEAD)
        digests[number] = _digest(shared, place - first, parts[first : place + AHEAD + 1])
    return digests


def _digest(shared: Key, place: int, parts: Sequence[Key]) -> Key:
    return sha256(f"{shared}{place}{''.join(parts)}".encode()).hexdigest()[:16]
