"""Mesh frames of a shot for export: read from the store, and keyed by what decides the exported frame."""

from __future__ import annotations

from pipeline.dailies.interchange.exported_frame import ExportedFrame, exported_frame, has_colours
from pipeline.errors import FrameError
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import EXPORT
from pipeline.production.store import readers
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import to_plain


def frame_key(request: RenderRequest, number: int) -> Key:
    """Return the key of an exported frame: its mesh, the flow around it, and what colours its vertices."""
    from pipeline.production.render_inputs.shading import STEP, flow_cache_data

    motion, look = request.shot.motion, request.shot.picture.look
    return key_of(
        EXPORT.recipe,
        request.normals_key(number),
        flow_cache_data(motion, number, (-STEP, STEP)),
        str(motion.rate),
        to_plain(look) if has_colours(look) or look.texture_projection else None,
    )


def stored_frame(request: RenderRequest, store: Store, number: int) -> ExportedFrame:
    """Return a frame of a shot for other programs, from the store.

    Raises FrameError where its mesh is missing or damaged, and what `exported_frame` raises.
    """
    key = request.mesh_key(number)
    if not store.holds("mesh", key):
        raise FrameError("it was not simulated, so it is not exported", number)
    frame = store.read("mesh", key, request.place("mesh", number), readers.mesh_frame(key))
    return exported_frame(request.shot, frame)
