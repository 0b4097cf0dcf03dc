"""Reflection of materials in quick previews: a matt body, a mirror of its colour, and a clear coat."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.scene.materials import BrushedMetal, Diffuse, Gouraud, Material, Metal, Plastic, Satin, Smoke

SHARPNESS = (6.0, 160.0)
"""Least and greatest exponent of highlights at vertices: sharper ones fall between them, as dots."""

COAT = 0.04
"""Reflectance of a clear coat seen from straight above; its index of refraction is 1.5."""

_LEAVES_COAT, _RETURNS = 0.42, 0.6
"""Fraction of light that a coat of index 1.5 lets in and out again, and the fraction that it sends back from
inside to the body (Egan and Hilgeman 1973): a body under a coat is darker than its colour."""


class Reflectance(NamedTuple):
    """Weights of reflection, in the order in which the kernel `shade_vertices` reads them.

    body      of the colour, in all directions
    mirror    of the colour, in the mirror direction
    coat      reflectance of a clear coat seen from straight above
    grazing   its reflectance at a grazing angle
    exponent  of highlights (Blinn 1977)
    """

    body: float
    mirror: float
    coat: float
    grazing: float
    exponent: float


def reflectance_of(material: Material, sharpness: tuple[float, float] = SHARPNESS) -> Reflectance:
    """Return the reflectance of a material. sharpness: the least and greatest exponent"""
    exponent = float(np.clip(2.0 / max(material.roughness, 0.02) ** 2 - 2.0, *sharpness))
    grazing = 1.0 - material.roughness
    match material:
        case Diffuse() | Smoke() | Gouraud():
            return Reflectance(1.0, 0.0, 0.0, 0.0, exponent)
        case Metal() | BrushedMetal():
            return Reflectance(0.0, 1.0, 0.0, 0.0, exponent)
        case Satin():
            coat = COAT * (1.0 - material.metallic)
            return Reflectance(1.0 - material.metallic, material.metallic, coat, 0.5 * grazing, exponent)
    if material.is_clear:
        return Reflectance(0.0, 0.0, COAT, 1.0, exponent)
    return Reflectance(1.0, 0.0, COAT, max(grazing, COAT), exponent)


def body_colours(material: Material, colours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the reflectances (N, 3) of bodies with these colours (N, 3): under a coat, less."""
    if not isinstance(material, Plastic):
        return colours
    return _LEAVES_COAT * colours / (1.0 - _RETURNS * colours)


def shadow_opacity(material: Material) -> float:
    """Return the fraction of the key light that a subject's shadow lacks."""
    return 1.0 - math.exp(-0.7 * material.density) if isinstance(material, Smoke) else 1.0


def contact_opacity(material: Material) -> float:
    """Return the fraction of light from above that a subject keeps from the floor where it touches it."""
    if isinstance(material, Smoke):
        return 0.5 * shadow_opacity(material)
    return 0.6 if material.is_clear else 1.0
