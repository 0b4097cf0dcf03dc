"""What the EXR of a raw picture says of itself: enough to make it again, or to tell what it was made from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pipeline.production.keys.stages import RENDER, SIMULATE, SMOOTH_NORMALS
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.request.picture_keys import PictureKeys
from pipeline.production.request.render_request import Take
from render.base.serialise import to_plain


def raw_header(take: Take, number: int, framing: Framing, keys: PictureKeys) -> dict[str, Any]:
    """Names and plain data, which stand in the file as `flowsculpt:` entries."""
    resampling = take.shot.motion.resampling_at(take.poses[number].mesh)
    return {
        "shot": take.shot.name,
        "frame": number,
        "quality": take.quality_name,
        "variant": take.variant,
        "key": keys.raw,
        "mesh_key": take.mesh_key(take.poses[number].mesh),
        "seed": take.seed(number),
        "pose": to_plain(take.poses[number]),
        "normals_key": take.normals_key(take.poses[number].mesh),
        "stages": {stage.name: stage.recipe for stage in (SIMULATE, SMOOTH_NORMALS, RENDER)},
        "look": to_plain(take.shot.picture.look),
        "lights": to_plain(replace(take.shot.picture.lights, exposure=0.0)),
        "stage": to_plain(take.shot.picture.stage),
        "settings": to_plain(take.quality),
        "shutter": take.open_at(number),
        **framing.as_data(),
        "stage_placement": to_plain(framing.placement),  # resampling has a setting of the shorter name
        **(resampling.settings() if resampling else {"resample": "off"}),
    }
