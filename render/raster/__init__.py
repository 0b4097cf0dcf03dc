"""The quick preview: surfaces by a depth buffer, lit by the shot's own rig and shown by the same view.

Colours are found at vertices and mixed between them (Gouraud 1971). No light bounces: softboxes shine as
points do, the first of them or else the sun casts a shadow, and the sky lights what looks up.
"""

from render.raster.lines import with_lines
from render.raster.parts import Preview, Set, Shape
from render.raster.picture import Edges, prepare, preview

__all__ = ["Edges", "Preview", "Set", "Shape", "prepare", "preview", "with_lines"]
