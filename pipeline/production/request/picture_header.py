"""The header of a rendered picture: all that it is made from, with the keys, so that it can be made again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.production.request.keys import FrameKeys
from pipeline.production.stages import FRAME_CAMERA, RENDER, SIMULATE, SMOOTH_NORMALS
from render.base.serialise import from_plain, to_plain
from render.scene.projection import PERSPECTIVE, Projection

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing
    from pipeline.production.request.render_request import RenderRequest


def raw_header(request: RenderRequest, number: int, framing: Framing, keys: FrameKeys) -> dict[str, Any]:
    """Return what the EXR of a raw picture says of itself, plain data: enough to make it again.

    It stands in the file as `flowsculpt:` entries.
    """
    return {
        "key": keys.raw,
        **to_plain(framing),
        "stage_placement": to_plain(framing.placement),  # resampling has a setting of the shorter name
        **picture_header(request, number),
    }


def picture_header(request: RenderRequest, number: int) -> dict[str, Any]:
    """Return the part of `raw_header` that is known before the shot is framed.

    inputs  digests of the files that the shot reads, by their names without folders
    """
    angle, picture = request.angles[number], request.picture(number)
    resampling = request.shot.motion.resampling_at(angle.mesh)
    several = {"subjects": [_subject_header(part, number) for part in request.parts]}
    return {
        "shot": request.shot.name,
        "frame": number,
        "quality": request.quality_name,
        "variant": request.variant,
        "mesh_key": request.mesh_key(angle.mesh),
        "seed": request.seed(number),
        "angle": to_plain(angle),
        "normals_key": request.normals_key(angle.mesh),
        "inputs": {Path(path).name: digest for path, digest in request.source.summary.inputs},
        "stages": {stage.name: stage.recipe for stage in (SIMULATE, SMOOTH_NORMALS, FRAME_CAMERA, RENDER)},
        "look": to_plain(picture.look),
        "lights": to_plain(replace(picture.lights, exposure=0.0)),
        "stage": to_plain(picture.stage),
        "settings": to_plain(request.quality_of(number)),
        "dicing": picture.dicing,
        "aovs": dict(request.aovs.precision),
        "working_space": picture.working_space.name,
        "shutter": request.open_at(number),
        **(resampling.settings() if resampling else {"resample": "off"}),
        **(several if request.shot.subjects else {}),
    }


def projection_of(header: Mapping[str, Any]) -> Projection:
    """Return the projection of a picture by its header."""
    wide = header.get("camera", {}).get("wide")
    return from_plain(Projection, wide) if wide else PERSPECTIVE


def _subject_header(part: RenderRequest, number: int) -> dict[str, Any]:
    """Return what the header says of one of several subjects."""
    mesh = part.angles[number].mesh
    resampling = part.shot.motion.resampling_at(mesh)
    return {
        "name": part.source.subject,
        "look": to_plain(part.picture(number).look),
        "mesh_key": part.mesh_key(mesh),
        "normals_key": part.normals_key(mesh),
        **(resampling.settings() if resampling else {"resample": "off"}),
    }
