"""From a shot to its surfaces, frame after frame."""

from flowsculpt.pipeline.animation.frame import (
    FrameReport,
    MeshFrame,
    descent,
    material_of,
    mesh_at_subframe,
    moved_to_subframe,
)
from flowsculpt.pipeline.animation.loop import FrameProgress, FrameProgressCallback, animate

__all__ = [
    "FrameProgress",
    "FrameProgressCallback",
    "FrameReport",
    "MeshFrame",
    "animate",
    "descent",
    "material_of",
    "mesh_at_subframe",
    "moved_to_subframe",
]
