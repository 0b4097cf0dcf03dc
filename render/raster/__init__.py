"""The quick preview: a rasteriser with a depth buffer, lit by the shot's light rig and shown by its colour
view.

Colours are computed at vertices and interpolated (Gouraud 1971). No light bounces: softboxes shine like
points, the first of them (or else the sun) casts a shadow, and the sky lights what faces up.
"""

from render.raster.preview import Edges, Preview, prepare, preview, with_lines
from render.raster.shapes import Shape, StageSetup

__all__ = ["Edges", "Preview", "Shape", "StageSetup", "prepare", "preview", "with_lines"]
