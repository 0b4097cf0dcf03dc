"""From a shot to its surfaces, frame after frame."""

from pipeline.animation.frame import FrameReport, MeshFrame, descent, material_of, mesh_at_subframe
from pipeline.animation.loop import animate

__all__ = ["FrameReport", "MeshFrame", "animate", "descent", "material_of", "mesh_at_subframe"]
