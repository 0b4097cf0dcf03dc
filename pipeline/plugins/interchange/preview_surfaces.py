"""Preview surfaces: what looks are nearest to in other programs, a colour and a few numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

from flowsculpt.api.materials import (
    BrushedMetal,
    Diffuse,
    Glass,
    Glossy,
    Metal,
    MitsubaMaterial,
    PatternedMaterial,
    Satin,
    Smoke,
)
from flowsculpt.api.pictures import Material, Painted

Colour = tuple[float, float, float]
"""Linear Rec.709 red, green and blue."""

CLEAR_OPACITY = 0.3
"""Opacity of clear bodies. Readers do not refract at a preview surface; at 0 some would show nothing."""


class PreviewSurface(NamedTuple):
    """Inputs of a UsdPreviewSurface. `colour` is linear Rec.709; the others lie between 0 and 1.

    Roughness is the root of the width of GGX lobes, as UsdPreviewSurface and glTF have it.
    """

    colour: Colour
    roughness: float
    metallic: float = 0.0
    clearcoat: float = 0.0
    opacity: float = 1.0
    refraction: float = 1.5
    is_matt: bool = False


def preview_surface(look: Material) -> PreviewSurface:
    """Return the preview surface that is nearest to a look."""
    if isinstance(look, Painted) and len(look.parts) == 1:
        (look,) = look.parts
    surface = _preview_surface(look)
    opacity = look.opacity if isinstance(look, PatternedMaterial) else None
    return surface if opacity is None else surface._replace(opacity=opacity.factor)


def _preview_surface(look: Material) -> PreviewSurface:
    if isinstance(look, Metal | BrushedMetal):
        return PreviewSurface(look.colour, math.sqrt(look.roughness), metallic=1.0)
    if isinstance(look, Satin):
        return PreviewSurface(look.colour, look.roughness, look.metallic, look.coat)
    if isinstance(look, Glass):
        return PreviewSurface(
            look.auxiliary_colour,
            math.sqrt(look.roughness),
            opacity=CLEAR_OPACITY,
            refraction=look.refraction,
        )
    if isinstance(look, Smoke):
        return PreviewSurface(look.colour, 1.0, opacity=CLEAR_OPACITY, is_matt=True)
    if isinstance(look, MitsubaMaterial):
        return PreviewSurface(look.colour, look.roughness)
    if isinstance(look, Glossy):
        return PreviewSurface(look.colour, math.sqrt(look.roughness))
    return PreviewSurface(look.colour, 1.0, is_matt=isinstance(look, Diffuse))
