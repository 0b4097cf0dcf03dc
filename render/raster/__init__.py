"""The quick preview: a rasteriser with a depth buffer, lit by the shot's light rig and shown by its colour
view.

Colours are computed at vertices and interpolated (Gouraud 1971). Softboxes shine like points; the first of
them (or else the sun) casts a shadow. Stage and sky light the subject by direction, as if it were alone; the
floor is dark below it. The stage is seen through clear subjects.
"""

from flowsculpt.render.raster.preview import Edges, Preview, prepare, preview, wide_picture, with_lines
from flowsculpt.render.raster.preview_pixels import draw_preview
from flowsculpt.render.raster.raster_shapes import Shape, StageSetup

__all__ = [
    "Edges",
    "Preview",
    "Shape",
    "StageSetup",
    "draw_preview",
    "prepare",
    "preview",
    "wide_picture",
    "with_lines",
]
