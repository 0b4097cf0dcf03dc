"""From a shot to its surfaces, frame after frame."""

from pipeline.animation.frame import FrameReport, MeshFrame
from pipeline.animation.loop import animate
from pipeline.animation.queries import descent, material_of, mesh_at_subframe

__all__ = ["FrameReport", "MeshFrame", "animate", "descent", "material_of", "mesh_at_subframe"]
