"""Looks as inputs of OpenPBR 1.1 (Academy Software Foundation, 2024), the surface model of MaterialX.

Unlike a preview surface it refracts, absorbs, and scatters light below a surface and inside a body. Roughness
is the root of the width of GGX lobes.
"""

from __future__ import annotations

import math
from typing import Any

from flowsculpt.api.materials import Diffuse, Glass, Gouraud, Plastic, Satin, Smoke
from flowsculpt.api.pictures import Material, Painted
from flowsculpt.pipeline.plugins.interchange.preview_surfaces import Colour, preview_surface

Inputs = dict[str, float | Colour]

LENGTHS = ("transmission_depth", "subsurface_radius")
"""Inputs in halves of the subject's size, which a stage needs in scene units."""

_COAT = {"coat_ior": 1.5, "coat_roughness": 0.16, "coat_darkening": 0.0}
_COAT_WEIGHT, _SHEEN_TINT = 0.25, 0.5
"""The clear coat and the sheen of the principled BSDF that draws satin (Burley 2012, section 5.3)."""


def openpbr_inputs(look: Material) -> Inputs:
    """Return the inputs by their names, without those at their defaults; LENGTHS in halves of a subject."""
    if isinstance(look, Painted) and len(look.parts) == 1:
        (look,) = look.parts
    if isinstance(look, Glass):
        return _glass(look)
    if isinstance(look, Smoke):
        return _smoke(look)
    surface = preview_surface(look)
    inputs: Inputs = {
        "base_color": surface.colour,
        "base_metalness": surface.metallic,
        "specular_roughness": surface.roughness,
        "geometry_opacity": surface.opacity,
    }
    if surface.is_matt or isinstance(look, Gouraud):
        inputs["specular_weight"] = 0.0
    if isinstance(look, Satin):
        inputs |= {"coat_weight": _COAT_WEIGHT * look.coat, "fuzz_weight": look.sheen} | _COAT
        inputs["fuzz_color"] = _mixed(look.colour, _SHEEN_TINT)
    if isinstance(look, Diffuse | Plastic) and look.subsurface is not None:
        inputs |= _body(look.colour, look.subsurface.radius)
    return inputs


def _body(colour: Colour, radius: Colour) -> Inputs:
    """Return the inputs of an opaque body that scatters light below its surface."""
    longest = max(radius)
    return {
        "subsurface_weight": 1.0,
        "subsurface_color": colour,
        "subsurface_radius": longest,
        "subsurface_radius_scale": _each(radius, lambda part: part / longest),
    }


def _glass(glass: Glass) -> Inputs:
    """Return the inputs of a clear body.

    OpenPBR colours either its surface or its inside. Where there is a medium, the colours of the two passages
    through the surface become absorption along the subject's size, which is two halves.
    """
    inputs: Inputs = {
        "base_color": glass.auxiliary_colour,
        "specular_roughness": math.sqrt(glass.roughness),
        "specular_ior": glass.refraction,
        "transmission_weight": 1.0,
    }
    if glass.absorption is None and glass.subsurface is None:
        return inputs | {"transmission_color": glass.colour}
    absorbed = glass.absorption.rate if glass.absorption is not None else (0.0, 0.0, 0.0)
    surface = _each(glass.colour, lambda part: -math.log(max(part, 1e-6)))
    scattered = (0.0, 0.0, 0.0)
    depth = glass.absorption.depth if glass.absorption is not None else 1.0
    if glass.subsurface is not None:
        scattered = _each(glass.subsurface.radius, lambda part: 1.0 / part)
        depth = min(glass.subsurface.radius)  # so that no part of `transmission_scatter` is above 1
    lost = [sum(parts) for parts in zip(absorbed, surface, scattered, strict=True)]
    red, green, blue = (math.exp(-rate * depth) for rate in lost)
    inputs |= {"transmission_color": (red, green, blue), "transmission_depth": depth}
    if glass.subsurface is not None:
        inputs["transmission_scatter"] = _each(scattered, lambda part: part * depth)
    return inputs


def _smoke(smoke: Smoke) -> Inputs:
    """Return the inputs of a cloud: a body whose surface neither reflects nor refracts."""
    left = math.exp(-1.0)  # of light that went one mean distance between two scattering events
    return {
        "base_color": smoke.colour,
        "specular_weight": 0.0,
        "specular_ior": 1.0,
        "specular_roughness": 0.0,
        "transmission_weight": 1.0,
        "transmission_color": (left, left, left),
        "transmission_depth": 1.0 / smoke.density,
        "transmission_scatter": smoke.colour,
    }


def _mixed(colour: Colour, share: float) -> Colour:
    """Return white with a share of a hue."""
    brightest = max(*colour, 1e-9)
    return _each(colour, lambda part: 1.0 - share + share * part / brightest)


def _each(values: Colour, of: Any) -> Colour:
    red, green, blue = (of(value) for value in values)
    return red, green, blue
