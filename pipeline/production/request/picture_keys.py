"""The keys of a request's cameras and raw pictures: digests of all that these are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import FRAME_CAMERA, RENDER
from render.base.serialise import to_plain

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing
    from pipeline.production.request.render_request import RenderRequest


def cameras_key(request: RenderRequest) -> Key:
    """Return the key of the cameras: they depend on all meshes that the request shows."""
    shown = sorted({angle.mesh for angle in request.angles.values()})
    return key_of(
        FRAME_CAMERA.recipe,
        [request.mesh_key(n) for n in shown],
        [[n, angle.mesh, angle.spin, request.view(n)] for n, angle in request.angles.items()],
        request.aspect,
        request.follow,
        request.net_pieces,
        request.shot.picture.stage.camera_move,
    )


def appearance(request: RenderRequest) -> Key:
    """Return the digest of what all pictures of a request share."""
    picture = request.shot.picture
    return key_of(
        to_plain(picture.look),
        to_plain(replace(picture.lights, exposure=0.0)),
        to_plain(picture.stage),
        to_plain(request.quality),
        request.variant,
        picture.dicing,
    )


def raw_key(request: RenderRequest, number: int, framings: Mapping[int, Framing]) -> Key:
    """Return the key of a rendered picture; `framings` are the cameras of the request."""
    angle = request.angles[number]
    return key_of(
        RENDER.recipe,
        request.normals_key(angle.mesh),
        [angle.spin, angle.lights] if angle.lights else angle.spin,
        to_plain(framings[number]),
        request.appearance,
        request.seed(number),
        *_motion_data(request, number, framings),
        *speed_data(request, number),
    )


def _motion_data(request: RenderRequest, number: int, framings: Mapping[int, Framing]) -> list[Any]:
    """Return what decides AOVs and motion blur of a picture; nothing if it has neither."""
    precision, offsets = request.aovs.precision, request.offsets(number)
    if not (precision or offsets):
        return []
    around = [to_plain(framings[n]) for n in (number - 1, number + 1) if n in framings]
    turn = request.turntable.step(number) if request.turntable else None
    flow: list[Any] = []
    if request.turntable is None and offsets:
        from pipeline.production.render_inputs.motion import flow_cache_data

        flow = flow_cache_data(request.shot.motion, number, offsets)
    return [list(map(list, precision)), request.open_at(number), flow, turn, around if offsets else []]


def speed_data(request: RenderRequest, number: int) -> list[Any]:
    """Return what decides the colours of a picture that shows speeds; nothing of others."""
    if not request.measures_speed:
        return []
    from pipeline.production.render_inputs.motion import STEP, flow_cache_data
    from render.scene.measure import SPEED

    return [[SPEED, flow_cache_data(request.shot.motion, request.angles[number].mesh, (-STEP, STEP))]]
