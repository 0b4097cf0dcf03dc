"""From a shot to its surfaces, frame after frame."""

from pipeline.animation.frame import FrameReport, MeshFrame
from pipeline.animation.lineage import descent
from pipeline.animation.loop import animate
from pipeline.animation.material import material_of
from pipeline.animation.subframe import at_moment

__all__ = ["FrameReport", "MeshFrame", "animate", "at_moment", "descent", "material_of"]
