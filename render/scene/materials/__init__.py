"""Materials: what the sculpture is made of. Plain descriptions; `render.mitsuba.materials` builds them."""

from flowsculpt.render.scene.materials.material import (
    Absorption,
    Material,
    Opacity,
    PatternedMaterial,
    PreviewSurface,
    Relief,
    Subsurface,
)
from flowsculpt.render.scene.materials.mitsuba_bsdf import Bsdf
from flowsculpt.render.scene.materials.models import (
    LOOKS,
    BrushedMetal,
    Diffuse,
    Glass,
    Glossy,
    Gouraud,
    Metal,
    MitsubaMaterial,
    Painted,
    Plastic,
    Satin,
    Smoke,
)

__all__ = [
    "LOOKS",
    "Absorption",
    "BrushedMetal",
    "Bsdf",
    "Diffuse",
    "Glass",
    "Glossy",
    "Gouraud",
    "Material",
    "Metal",
    "MitsubaMaterial",
    "Opacity",
    "Painted",
    "PatternedMaterial",
    "Plastic",
    "PreviewSurface",
    "Relief",
    "Satin",
    "Smoke",
    "Subsurface",
]
