"""From a shot to its surfaces, frame after frame."""

from pipeline.animation.frame import FrameReport, MeshFrame
from pipeline.animation.loop import animate
from pipeline.animation.queries import at_moment, descent, material_of

__all__ = ["FrameReport", "MeshFrame", "animate", "at_moment", "descent", "material_of"]
