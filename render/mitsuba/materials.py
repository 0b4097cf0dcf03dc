"""Looks as Mitsuba's materials. An engine must have been started before anything here is called."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.mitsuba import absorption
from render.mitsuba import bitmaps as laid
from render.mitsuba import bsdf_check as inline
from render.mitsuba.texture_coordinates import Marks
from render.scene.look import Look
from render.scene.measure import Measure
from render.scene.patterns import Pigment

_LEAST_DEPTH = {"glass": 10, "smoke": 16}
"""Vertices of a path that light needs to get through; shorter ones leave a body black."""

_ALONG = 0.3
"""How rough brushed metal is along its scratches, as a share of how rough it is across."""

_STREAKED = 0.3
"""How much less than its colour the deepest scratch reflects."""


def material(look: Look, attributes: Collection[str], marks: Marks, size: float) -> Any:
    """What a surface is made of. Raises BadInputError for a look that wants an attribute it does not have.

    marks  what the surface's texture coordinates mean
    size   half the subject's, scene units
    """
    if look.model == "smoke":
        return {"type": "null"}
    if look.bsdf is not None:
        return inline.material(look.bsdf, marks, look.projection)
    colour = _colour(look, attributes, marks)
    if look.model == "glass":
        return {
            "type": "dielectric",
            "int_ior": look.refraction,
            "specular_transmittance": colour,
            **absorption.textures(look, size),
        }
    opaque = _opaque(look, colour, marks)
    if look.relief is not None:
        height = laid.bitmap(look.relief.texture.numbers(), marks, look.projection)
        opaque = {"type": "bumpmap", "relief": height, "scale": look.relief.height, "material": opaque}
    return {"type": "twosided", "material": opaque}


def guide(look: Look) -> dict[str, Any]:
    """What a body that light goes through is made of for the denoiser: without this it would be black."""
    left = look.absorption.colour if look.absorption else (1.0, 1.0, 1.0)
    colour = [part * share for part, share in zip(look.colour, left, strict=True)]
    plain = {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}
    return {"type": "twosided", "material": plain}


def medium(look: Look, size: float) -> dict[str, Any] | None:
    """What fills the surface, or nothing. size: half the subject's, scene units"""
    if look.model != "smoke":
        return absorption.medium(look, size)
    albedo = {"type": "rgb", "value": list(look.colour)}
    return {"type": "homogeneous", "albedo": albedo, "scale": look.density / size}


def path(look: Look, depth: int) -> dict[str, Any]:
    """How light is followed: far enough to get through."""
    depth = max(depth, _LEAST_DEPTH.get(look.model, _LEAST_DEPTH["glass"] if look.is_clear else 0))
    kind = "volpath" if look.model == "smoke" else absorption.path(look)
    return {"type": kind, "max_depth": depth, "rr_depth": max(depth, 5)}


def _colour(look: Look, attributes: Collection[str], marks: Marks) -> dict[str, Any]:
    if look.picture is not None:
        return laid.bitmap(look.picture.pixels(), marks, look.projection)
    dye = look.pigment or look.measure
    if dye is not None:
        return _row(dye, look.repeats)
    if look.colour_from is None:
        return {"type": "rgb", "value": list(look.colour)}
    if look.colour_from not in attributes:
        known = ", ".join(attributes) or "none"
        raise BadInputError(
            f"look takes its colour from attribute {look.colour_from!r}; the surface has {known}"
        )
    return {"type": "mesh_attribute", "name": f"vertex_{look.colour_from}"}


def _row(dye: Pigment | Measure, repeats: bool) -> dict[str, Any]:
    """A picture one row high, along the first texture coordinate."""
    import mitsuba as mi

    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.array(dye.row()[None], order="C")),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat" if repeats else "clamp",
    }


def _opaque(look: Look, colour: dict[str, Any], marks: Marks) -> dict[str, Any]:
    if look.model == "diffuse":
        return {"type": "diffuse", "reflectance": colour}
    if look.model == "metal":
        return {
            "type": "roughconductor",
            "material": "none",
            "specular_reflectance": colour,
            "alpha": _roughness(look, marks),
            "distribution": "ggx",
        }
    if look.model == "brushed":
        return _brushed(look, marks)
    if look.model == "satin":
        return {
            "type": "principled",
            "base_color": colour,
            "roughness": look.roughness if look.rough is None else _roughness(look, marks),
            "metallic": look.metallic,
            "sheen": look.sheen,
            "sheen_tint": 0.5,
            "clearcoat": look.coat,
            "clearcoat_gloss": 0.75,
            "specular": 0.5,
        }
    if look.rough is not None:  # roughplastic has one roughness
        return {
            "type": "principled",
            "base_color": colour,
            "roughness": _roughness(look, marks, squared=True),
            "specular": 0.5,
        }
    return {
        "type": "roughplastic",
        "diffuse_reflectance": colour,
        "alpha": max(look.roughness, 1e-3),
        "distribution": "ggx",
        "nonlinear": True,
    }


def _roughness(look: Look, marks: Marks, squared: bool = False) -> Any:
    """A number or a picture. squared: for Mitsuba's principled material, which squares what it is given"""
    if look.rough is None:
        return max(look.roughness, 1e-3)
    numbers = np.clip(look.rough.numbers(), 1e-3, 1.0)
    return laid.bitmap(np.sqrt(numbers) if squared else numbers, marks, look.projection)


def _brushed(look: Look, marks: Marks) -> dict[str, Any]:
    """Metal whose highlights are drawn out across its scratches, which texture coordinates tell of."""
    import mitsuba as mi

    streaks = mi.Bitmap(np.ascontiguousarray(_streaks(look)[:, None]))
    shown = {
        "type": "bitmap",
        "bitmap": streaks,
        "raw": True,
        "filter_type": "bilinear",
        "to_uv": mi.ScalarTransform3f().scale([1.0, marks.factor]),
    }
    rough = max(look.roughness, 1e-3)
    return {
        "type": "roughconductor",
        "material": "none",
        "specular_reflectance": shown,
        "alpha_u": rough * _ALONG,
        "alpha_v": rough,
        "distribution": "ggx",
    }


def _streaks(look: Look) -> NDArray[np.float32]:
    """(N, 3): what metal reflects along one scene unit across its scratches, fine and coarse ones."""
    drawn, count = np.random.default_rng(11), 1024
    depth = np.zeros(count)
    for wide, strength in ((1, 0.5), (4, 0.3), (16, 0.2)):
        depth += strength * np.repeat(drawn.random(count // wide), wide)
    return np.asarray((1.0 - _STREAKED * depth)[:, None] * np.array(look.colour), dtype=np.float32)
