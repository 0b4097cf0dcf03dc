"""Looks as Mitsuba's materials. An engine must have been started before anything here is called."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from render.errors import BadInputError
from render.look import Look
from render.pigment import Pigment

_LEAST_DEPTH = {"glass": 10, "smoke": 16}
"""Vertices of a path that light needs to get through; shorter ones leave a body black."""


def material(look: Look, attributes: Collection[str]) -> dict[str, Any]:
    """What a surface is made of. Raises BadInputError for a look that wants an attribute it does not have."""
    if look.model == "smoke":
        return {"type": "null"}
    colour = _colour(look, attributes)
    if look.model == "glass":
        return {"type": "dielectric", "int_ior": look.refraction, "specular_transmittance": colour}
    return {"type": "twosided", "material": _opaque(look, colour)}


def guide(look: Look) -> dict[str, Any]:
    """What a body that light goes through is made of for the denoiser: without this it would be black."""
    plain = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(look.colour)}}
    return {"type": "twosided", "material": plain}


def medium(look: Look, size: float) -> dict[str, Any] | None:
    """What fills the surface, or nothing. size: half the subject's, scene units"""
    if look.model != "smoke":
        return None
    albedo = {"type": "rgb", "value": list(look.colour)}
    return {"type": "homogeneous", "albedo": albedo, "scale": look.density / size}


def path(look: Look, depth: int) -> dict[str, Any]:
    """How light is followed: far enough to get through."""
    depth = max(depth, _LEAST_DEPTH.get(look.model, 0))
    kind = "volpath" if look.model == "smoke" else "path"
    return {"type": kind, "max_depth": depth, "rr_depth": max(depth, 5)}


def _colour(look: Look, attributes: Collection[str]) -> dict[str, Any]:
    if look.pigment is not None:
        return _row(look.pigment)
    if look.colour_from is None:
        return {"type": "rgb", "value": list(look.colour)}
    if look.colour_from not in attributes:
        known = ", ".join(attributes) or "none"
        raise BadInputError(
            f"look takes its colour from attribute {look.colour_from!r}; the surface has {known}"
        )
    return {"type": "mesh_attribute", "name": f"vertex_{look.colour_from}"}


def _row(pigment: Pigment) -> dict[str, Any]:
    """A picture one row high, along the first texture coordinate."""
    import mitsuba as mi

    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(pigment.row()[None])),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat" if pigment.repeats else "clamp",
    }


def _opaque(look: Look, colour: dict[str, Any]) -> dict[str, Any]:
    if look.model == "diffuse":
        return {"type": "diffuse", "reflectance": colour}
    if look.model == "metal":
        return {
            "type": "roughconductor",
            "material": "none",
            "specular_reflectance": colour,
            "alpha": max(look.roughness, 1e-3),
            "distribution": "ggx",
        }
    if look.model == "satin":
        return {
            "type": "principled",
            "base_color": colour,
            "roughness": look.roughness,
            "metallic": look.metallic,
            "sheen": look.sheen,
            "sheen_tint": 0.5,
            "clearcoat": 0.4,
            "clearcoat_gloss": 0.75,
            "specular": 0.5,
        }
    return {
        "type": "roughplastic",
        "diffuse_reflectance": colour,
        "alpha": max(look.roughness, 1e-3),
        "distribution": "ggx",
        "nonlinear": True,
    }
