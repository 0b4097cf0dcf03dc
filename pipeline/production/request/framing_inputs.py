"""Digests of what decides the camera of each picture: they tell which cameras stay before these are framed.

The cameras of a shot share a key, which any edit of a mesh changes. Most pictures keep their camera all the
same, for it depends on frames near them. Framing a shot notes the digests of what it framed; planning
compares them with those of today while the new cameras are not there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from pipeline.production.request.keys import CameraFile
from pipeline.production.stages import FRAME_CAMERA
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import from_plain, to_plain

if TYPE_CHECKING:
    from pipeline.production.request.render_request import RenderRequest


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
        cache, found_from = request.source.cache, ("framing inputs", request.identity)
        known = cache.get(*found_from)
        if known is not None:
            return from_plain(cls, known)
        digests = cls(_views(request), _inputs(request))
        cache.put(to_plain(digests), *found_from)
        return digests


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
        noted = request.source.cache.get(*_place(request))
        path = request.folders.cameras()
        if noted is None or not store.shows("cameras", noted["key"], path):
            return None
        try:
            data: dict[str, Any] = json.loads((store.root / path).read_text())
            known = dict.fromkeys(number for number in request.angles if str(number) in data)
        except (OSError, ValueError, TypeError):
            return None
        before, now = from_plain(FramingInputs, noted["digests"]), FramingInputs.of(request)
        same = {n for n in known if before.inputs.get(n) == now.inputs[n]}
        return cls(
            cameras=CameraFile(store, noted["key"], known, lambda: data),
            settled=frozenset(n for n in same if {n - 1, n + 1} & set(request.angles) <= same),
            moved=frozenset(n for n in known if before.views.get(n) != now.views[n]),
        )


def note_framing(request: RenderRequest) -> None:
    """Note what the cameras of a request were framed from."""
    data = {"key": request.cameras_key, "digests": to_plain(FramingInputs.of(request))}
    request.source.cache.put(data, *_place(request))


def _place(request: RenderRequest) -> tuple[Any, ...]:
    return "framed", request.folders.cameras().as_posix()


def _views(request: RenderRequest) -> dict[int, Key]:
    """Return digests of the values of each view that framing takes as they are."""
    digests = {}
    for number in request.angles:
        view = request.view(number)
        direction = (view.azimuth + view.orbit, view.elevation) if view.position is None else view.position
        digests[number] = key_of(direction, view.target, view.roll, view.field_of_view)[:16]
    return digests


def _inputs(request: RenderRequest) -> dict[int, Key]:
    """Return digests of all that decides each camera.

    One that follows the sculpture depends on the frames near its own, others on all frames.
    """
    from pipeline.production.render_inputs.framing import AHEAD

    numbers = sorted(request.angles)
    views = {number: request.view(number) for number in numbers}
    move = request.shot.picture.stage.camera_move
    shared = key_of(FRAME_CAMERA.recipe, request.aspect, request.follow, request.net_pieces, move)
    parts = [
        key_of(request.mesh_key(request.angles[n].mesh), request.angles[n].spin, views[n]) for n in numbers
    ]
    if request.follow != 1.0 or any(view.position is not None for view in views.values()):
        return dict.fromkeys(numbers, _digest(shared, 0, parts))
    digests = {}
    for place, number in enumerate(numbers):
        first = max(0, place - AHEAD)
        digests[number] = _digest(shared, place - first, parts[first : place + AHEAD + 1])
    return digests


def _digest(shared: Key, place: int, parts: Sequence[Key]) -> Key:
    return sha256(f"{shared}{place}{''.join(parts)}".encode()).hexdigest()[:16]
