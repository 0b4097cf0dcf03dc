"""What the EXR of a raw picture says of itself: enough to make it again, or to tell what it was made from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pipeline.production.keys.stages import RENDER, SIMULATE, SMOOTH_NORMALS
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.request.picture_keys import FrameKeys
from pipeline.production.request.render_request import RenderRequest
from render.base.serialise import to_plain


def raw_header(request: RenderRequest, number: int, framing: Framing, keys: FrameKeys) -> dict[str, Any]:
    """Names and plain data, which stand in the file as `flowsculpt:` entries."""
    resampling = request.shot.motion.resampling_at(request.angles[number].mesh)
    return {
        "shot": request.shot.name,
        "frame": number,
        "quality": request.quality_name,
        "variant": request.variant,
        "key": keys.raw,
        "mesh_key": request.mesh_key(request.angles[number].mesh),
        "seed": request.seed(number),
        "pose": to_plain(request.angles[number]),
        "normals_key": request.normals_key(request.angles[number].mesh),
        "stages": {stage.name: stage.recipe for stage in (SIMULATE, SMOOTH_NORMALS, RENDER)},
        "look": to_plain(request.shot.picture.look),
        "lights": to_plain(replace(request.shot.picture.lights, exposure=0.0)),
        "stage": to_plain(request.shot.picture.stage),
        "settings": to_plain(request.quality),
        "shutter": request.open_at(number),
        **framing.as_data(),
        "stage_placement": to_plain(framing.placement),  # resampling has a setting of the shorter name
        **(resampling.settings() if resampling else {"resample": "off"}),
    }
