"""The camera of a still, which depends on frames after it: for these a sample of its points is moved.

Nothing is resampled after the still's own frame, so that a still takes the time of the frames up to it. The
sample lies on the same surface as the vertices of those frames; a camera differs by what lies between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.animation.surface import step_into
from pipeline.arrays import AnyArray, Indices
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.errors import FrameError
from pipeline.production.render_inputs.framing import Framing, frame_all, with_stage_in_view
from pipeline.production.render_inputs.view_geometry import BoundingSpheres, Extent
from pipeline.production.request.render_request import RenderRequest

MOST_SAMPLED = 4000
"""Points of a still that are moved on, about."""

DIRECTIONS = 200
"""Directions in which the outermost points are in the sample."""


def framing_of_still(
    request: RenderRequest, stream: SurfaceStream, number: int, numbers: Sequence[int]
) -> Framing:
    """Return camera and stage of a frame.

    numbers  all frames that they depend on; the stream has played those up to the frame
    """
    extents = [_extent(stream.arrays(request, n)) for n in numbers if n <= number]
    last = len(extents)
    extents += _moved(request, extents[-1], numbers[last:])
    views = [request.view(n) for n in numbers[: len(extents)]]
    framing = frame_all(views, lambda i: extents[i], request.aspect, request.follow)[last - 1]
    return with_stage_in_view(framing, request.shot.picture.stage)


def _extent(arrays: dict[str, AnyArray]) -> Extent:
    points = arrays["vertices"]
    return BoundingSpheres(points, arrays["radii"]) if "radii" in arrays else points


def _moved(request: RenderRequest, extent: Extent, numbers: Sequence[int]) -> list[Extent]:
    """Return a sample of an extent at later frames, up to the first at which the flow fails."""
    points, radii = extent if isinstance(extent, BoundingSpheres) else (extent, None)
    chosen, motion = outline(points), request.shot.motion
    moved, later = points[chosen].astype(np.float64), list[Extent]()
    for number in numbers:
        try:
            moved = step_into(motion, motion.flow, number).apply(moved)
        except FrameError:
            break  # the still itself is sound; a render stops there
        later.append(moved if radii is None else BoundingSpheres(moved, radii[chosen]))
    return later


def outline(points: AnyArray) -> Indices:
    """Return the indices of points spread over all, and of the outermost in many directions."""
    spread = np.arange(0, len(points), -(-len(points) // MOST_SAMPLED))
    height = (2.0 * np.arange(DIRECTIONS) + 1.0) / DIRECTIONS - 1.0
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(DIRECTIONS)  # a spiral of golden angles
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(turn), height, across * np.sin(turn)])
    outermost = [int((points @ direction).argmax()) for direction in directions.T]
    return np.unique(np.concatenate([spread, outermost]))
