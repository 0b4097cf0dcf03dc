"""Materials as Mitsuba's BSDFs, media and integrators. Functions need a started engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba import bsdf_plugins as bsdf
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.mitsuba.texture_coordinates import MIRRORED, ScaledCoordinates, bitmap
from flowsculpt.render.scene.materials import (
    BrushedMetal,
    Diffuse,
    Glass,
    Glossy,
    Material,
    Metal,
    MitsubaMaterial,
    Painted,
    PatternedMaterial,
    Plastic,
    Satin,
    Smoke,
)
from flowsculpt.render.scene.measured_colours import Measure, shows_values
from flowsculpt.render.scene.painted_faces import material_weight
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.textures import REPEATED

Description = dict[str, Any]

_MIN_ROUGHNESS = 1e-3

_ALONG_SCRATCHES = 0.3
"""Roughness along the scratches, over the roughness across."""

_SCRATCH_CONTRAST = 0.3
"""Fraction of the colour that the deepest scratch does not reflect."""


def surface_bsdf(
    material: Material, attributes: Collection[str], coordinates: ScaledCoordinates, size: float
) -> Any:
    """Return the BSDF of a surface with these vertex attributes and texture coordinates.

    size  half the subject's, scene units

    Raises BadInputError where the material needs an attribute that the surface does not have.
    """
    match material:
        case Smoke():
            return {"type": "null"}
        case MitsubaMaterial():
            return bsdf.build(material.bsdf, coordinates, material.projection)
        case Glass():
            return _glass(material, size)
        case BrushedMetal():
            return two_sided(_brushed(material, max(material.roughness, _MIN_ROUGHNESS)))
        case PatternedMaterial():
            if material.wear:
                return _worn(material, attributes, coordinates)
            colour = _colour(material, attributes, coordinates)
            opaque = _opaque(material, colour, coordinates)
            if isinstance(material, Diffuse | Plastic) and material.subsurface is not None and is_compiled():
                from flowsculpt.render.mitsuba.custom_plugins import SUBSURFACE  # needs a compiled variant

                opaque = {"type": SUBSURFACE, "body": opaque, "has_coat": isinstance(material, Plastic)}
            if isinstance(material, Diffuse | Glossy) and material.relief is not None:
                relief = material.relief
                height = bitmap(relief.texture.numbers(), coordinates, material.projection)
                opaque = {"type": "bumpmap", "relief": height, "scale": relief.height, "material": opaque}
            if material.pigment is not None and material.pigment.heights and is_compiled():
                from flowsculpt.render.mitsuba.pattern_textures import (
                    relief_normals,  # needs a compiled variant
                )

                normals = relief_normals(material.pigment)
                return {"type": "normalmap", "normalmap": normals, "body": two_sided(opaque)}
            return _with_normals((material,), two_sided(opaque), attributes, coordinates)
        case Painted():
            body = two_sided(_painted(material, attributes, coordinates))
            return _with_normals(material.parts, body, attributes, coordinates)
    raise TypeError(f"{material.model} has no BSDF")


def _worn(
    material: PatternedMaterial, attributes: Collection[str], coordinates: ScaledCoordinates
) -> Description:
    """Return the BSDF of a surface with wear over its colour and roughness, and the relief of the wear."""
    from flowsculpt.render.mitsuba import detail_textures  # needs a compiled variant

    colour = detail_textures.detailed_colour(_colour(material, attributes, coordinates), material.wear)
    body = two_sided(_opaque(material, colour, coordinates))
    normals = detail_textures.detail_normals(material.wear)
    return {"type": "normalmap", "normalmap": normals, "body": body}


def _painted(painted: Painted, attributes: Collection[str], coordinates: ScaledCoordinates) -> Description:
    """Return the materials of a model. Each vertex has the weight 1 for its own, by `material_weight`.

    In compiled variants one BSDF shows all glossy materials and one all matt ones, since each takes time at
    every vertex of a path. The scalar variant nests them.
    """
    if not painted.parts:
        return {"type": "diffuse", "reflectance": _rgb(painted.colour)}
    shown = _on_faces(painted.parts, attributes)
    first = shown.pop("otherwise")
    if not shown or not is_compiled():
        whole = _opaque(first, _colour(first, attributes, coordinates), coordinates)
        for name, part in shown.items():
            second = _opaque(part, _colour(part, attributes, coordinates), coordinates)
            whole = _blend(name, whole, second)
        return whole
    from flowsculpt.render.mitsuba.custom_plugins import PAINTED  # needs a compiled variant

    def of_each(value: Callable[[PatternedMaterial], Any]) -> Description:
        return {"type": PAINTED, "otherwise": value(first), **{name: value(p) for name, p in shown.items()}}

    def colour_of(part: PatternedMaterial) -> Description:
        colour = _colour(part, attributes, coordinates)
        is_constant = colour["type"] == "rgb"  # which a plug-in of ours would get as a number
        return {"type": "srgb", "color": colour["value"]} if is_constant else colour

    colour = of_each(colour_of)
    matt = {"type": "diffuse", "reflectance": colour}
    glossy = {
        "type": "principled",
        "base_color": colour,
        "roughness": of_each(lambda part: _number(part, "roughness", coordinates)),
        "metallic": of_each(lambda part: _number(part, "metallic", coordinates)),
        "specular": 0.5,
    }
    kinds = {isinstance(part, Glossy) for part in (first, *shown.values())}
    if len(kinds) == 1:
        return glossy if kinds == {True} else matt
    weight = of_each(lambda part: {"type": "uniform", "value": float(isinstance(part, Glossy))})
    return {"type": "blendbsdf", "weight": weight, "first": matt, "second": glossy}


def _with_normals(
    parts: Sequence[PatternedMaterial],
    body: Description,
    attributes: Collection[str],
    coordinates: ScaledCoordinates,
) -> Description:
    """Return the BSDF of a two-sided body with the normal maps of its materials, each on its own faces.

    Normals of the back are those of the front, turned round. The scalar variant nests two BSDFs for each map,
    with tangents that are constant on each triangle.
    """
    shown = _on_faces(parts, attributes)
    if not any(part.has_normal_map for part in shown.values()):
        return body

    if is_compiled():
        from flowsculpt.render.mitsuba.custom_plugins import NORMALS, PAINTED  # needs a compiled variant

        def mapped(part: PatternedMaterial) -> Description:
            if (normals := part.normal_texture) is None:
                return {"type": "srgb", "color": [0.0, 0.0, 1.0]}
            return bitmap(normals.normals(), coordinates, part.projection, normals.wrap)

        maps = {name: mapped(part) for name, part in shown.items()}
        normals = {"type": NORMALS, "map": {"type": PAINTED, **maps}}
        return {"type": "normalmap", "normalmap": normals, "body": body}

    def turned(part: PatternedMaterial) -> Description:
        if part.normal_texture is None:
            return body
        colours = [0.5 + 0.5 * part.normal_texture.normals() * (1.0, up, 1.0) for up in (1.0, -1.0)]
        wrap = part.normal_texture.wrap
        maps = (bitmap(each, coordinates, part.projection, wrap) for each in colours)
        return _blend(MIRRORED, *({"type": "normalmap", "normalmap": each, "body": body} for each in maps))

    whole = turned(shown.pop("otherwise"))
    for name, part in shown.items():
        whole = _blend(name, whole, turned(part))
    return whole


def _on_faces(
    parts: Sequence[PatternedMaterial], attributes: Collection[str]
) -> dict[str, PatternedMaterial]:
    """Return the materials of a model that faces have, by the vertex attribute that is 1 on their faces.

    The first is "otherwise". Nothing of a model without materials.
    """
    if not parts:
        return {}
    others = {material_weight(number): part for number, part in enumerate(parts) if number}
    return {"otherwise": parts[0], **{name: part for name, part in others.items() if name in attributes}}


def opacity_texture(
    material: Material, attributes: Collection[str], coordinates: ScaledCoordinates
) -> Description:
    """Return the texture of the fractions that are there of a surface with holes."""
    from flowsculpt.render.mitsuba.custom_plugins import PAINTED  # needs a compiled variant

    def fractions(part: PatternedMaterial) -> Description:
        whole, held = np.ones((1, 1, 1), np.float32), part.opacity
        pixels = whole if held is None else held.fractions()
        wrap = held.texture.wrap if held is not None and held.texture is not None else REPEATED
        return bitmap(pixels, coordinates, part.projection, wrap)

    assert isinstance(material, Painted | PatternedMaterial), f"{material.model} has no holes"
    parts = material.parts if isinstance(material, Painted) else (material,)
    return {"type": PAINTED, **{n: fractions(part) for n, part in _on_faces(parts, attributes).items()}}


def _blend(attribute: str, first: Description, second: Description) -> Description:
    """Return the second BSDF where a vertex attribute is 1, and the first where it is 0."""
    weight = {"type": "mesh_attribute", "name": f"vertex_{attribute}"}
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def _number(part: PatternedMaterial, name: str, coordinates: ScaledCoordinates) -> Description:
    """Return the roughness or metalness of a model's material as a texture."""
    texture = getattr(part, f"{name}_texture", None)
    if texture is not None:
        numbers = np.clip(texture.numbers(), _MIN_ROUGHNESS, 1.0)
        return bitmap(numbers, coordinates, part.projection, texture.wrap)
    return {"type": "uniform", "value": float(getattr(part, name, 0.0))}


def _glass(glass: Glass, size: float) -> Description:
    """Return a dielectric, in compiled variants with absorption and the light that a rough one would lose."""
    rough = {"type": "roughdielectric", "alpha": glass.roughness, "distribution": "ggx"}
    surface: Description = rough if glass.is_rough else {"type": "dielectric"}
    clear = {**surface, "int_ior": glass.refraction, "specular_transmittance": _rgb(glass.colour)}
    if not (glass.absorption or glass.is_rough) or not is_compiled():
        return clear
    from flowsculpt.render.mitsuba.custom_plugins import absorbing_textures  # needs a compiled variant

    return {**clear, **absorbing_textures(glass, size)}


def _brushed(material: BrushedMetal, roughness: float) -> dict[str, Any]:
    """Return the BSDF of one side. roughness: across the scratches"""
    import mitsuba as mi

    scratches = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(_scratches(material)[None])),
        "raw": True,
        "filter_type": "bilinear",
    }
    metal = {
        "type": "roughconductor",
        "material": "none",
        "specular_reflectance": scratches,
        "alpha_u": roughness,
        "alpha_v": roughness * _ALONG_SCRATCHES,
        "distribution": "ggx",
    }
    if not is_compiled():
        return metal
    from flowsculpt.render.mitsuba.custom_plugins import BRUSHED  # needs a compiled variant

    return {"type": BRUSHED, "metal": metal}


def _scratches(material: BrushedMetal) -> NDArray[np.float32]:
    """Return reflectances (N, 3) along one scene unit across the scratches, fine and coarse ones."""
    random, count = np.random.default_rng(11), 1024
    depth = np.zeros(count)
    for width, strength in ((1, 0.5), (4, 0.3), (16, 0.2)):
        depth += strength * np.repeat(random.random(count // width), width)
    return np.asarray(
        (1.0 - _SCRATCH_CONTRAST * depth)[:, None] * np.array(material.colour), dtype=np.float32
    )


def interior_medium(material: Material, size: float) -> Description | None:
    """Return the medium inside the surface, or None. size: half the subject's, scene units"""
    if isinstance(material, Smoke):
        albedo = _rgb(material.colour)
        return {"type": "homogeneous", "albedo": albedo, "scale": material.density / size}
    if not isinstance(material, Glass) or material.absorption is None or is_compiled():
        return None
    strongest = max(*material.absorption.rate, 1e-9)
    relative = _rgb([part / strongest for part in material.absorption.rate])
    return {"type": "homogeneous", "albedo": 0.0, "sigma_t": relative, "scale": strongest / size}


def path_integrator(shown: Sequence[Material], depth: int) -> Description:
    """Return Mitsuba's path integrator, with paths long enough to pass through each of the materials."""
    depth = max(depth, *(material.min_path_depth for material in shown))
    kinds = {_integrator(material) for material in shown}
    kind = next(kind for kind in ("volpathmis", "volpath", "path") if kind in kinds)
    return {"type": kind, "max_depth": depth, "rr_depth": max(depth, 5)}


def _integrator(material: Material) -> str:
    """Return the simplest integrator that can trace paths through a material."""
    if isinstance(material, Smoke):
        return "volpath"
    return "path" if interior_medium(material, 1.0) is None else "volpathmis"


def two_sided(opaque: Description) -> Description:
    """Return a BSDF that looks the same from both sides."""
    return {"type": "twosided", "material": opaque}


def diffuse(colour: tuple[float, ...]) -> Description:
    """Return a two-sided diffuse BSDF of a linear Rec.709 colour."""
    return two_sided({"type": "diffuse", "reflectance": _rgb(colour)})


def vertex_attribute(name: str) -> Description:
    """Return a two-sided diffuse BSDF whose colour is a vertex attribute (V, 3)."""
    return two_sided({"type": "diffuse", "reflectance": _attribute(name)})


def rough_conductor(reflectance: Any, roughness: Any) -> Description:
    """Return a metal BSDF with GGX roughness."""
    return {
        "type": "roughconductor",
        "material": "none",
        "specular_reflectance": reflectance,
        "alpha": roughness,
        "distribution": "ggx",
    }


def rough_plastic(reflectance: Any, roughness: float) -> Description:
    """Return a coated BSDF with GGX roughness."""
    if isinstance(reflectance, dict) and reflectance["type"] == "mesh_attribute":
        # Mitsuba's roughplastic asks for a texture's mean, which a vertex attribute does not know.
        return _principled_coat(reflectance, math.sqrt(roughness))
    return {
        "type": "roughplastic",
        "diffuse_reflectance": reflectance,
        "alpha": roughness,
        "distribution": "ggx",
        "nonlinear": True,
    }


def _principled_coat(colour: Any, roughness: Any) -> Description:
    """Return a coated BSDF whose roughness is the square root of GGX's, and may be a texture."""
    return {"type": "principled", "base_color": colour, "roughness": roughness, "specular": 0.5}


def _rgb(colour: Sequence[float]) -> Description:
    return {"type": "rgb", "value": list(colour)}


def _attribute(name: str) -> Description:
    return {"type": "mesh_attribute", "name": f"vertex_{name}"}


def _colour(
    material: PatternedMaterial, attributes: Collection[str], coordinates: ScaledCoordinates
) -> Description:
    if material.colour_texture is not None:
        wrap = material.colour_texture.wrap
        return bitmap(material.colour_pixels(), coordinates, material.projection, wrap)
    if material.pigment is not None and is_compiled():
        from flowsculpt.render.mitsuba.pattern_textures import pattern_texture  # needs a compiled variant

        return pattern_texture(material.pigment)
    if material.pattern is not None:
        return _ramp_bitmap(material.pattern)
    if material.colour_from is None:
        return _rgb(material.colour)
    if material.colour_from not in attributes:
        known = ", ".join(attributes) or "none"
        raise BadInputError(
            f"look takes its colour from attribute {material.colour_from!r}; the surface has {known}"
        )
    return _attribute(material.colour_from)


def _ramp_bitmap(pattern: Pigment | Measure) -> Description:
    """Return a bitmap of one row, looked up by the first texture coordinate."""
    import mitsuba as mi

    row = pattern.ramp_with_missing() if shows_values(pattern) else pattern.ramp()
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.array(row[None], order="C")),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat" if pattern.repeats else "clamp",
    }


def _opaque(material: PatternedMaterial, colour: Description, coordinates: ScaledCoordinates) -> Description:
    if isinstance(material, Diffuse):
        return {"type": "diffuse", "reflectance": colour}
    assert isinstance(material, Glossy), f"{material.model} is not lit"
    if isinstance(material, Metal):
        return rough_conductor(colour, _roughness(material, coordinates))
    if isinstance(material, Satin):
        has_texture = material.has_varied_roughness
        metallic: Any = material.metallic
        if material.metallic_texture is not None:
            numbers = np.clip(material.metallic_texture.numbers(), 0.0, 1.0)
            metallic = bitmap(numbers, coordinates, material.projection, material.metallic_texture.wrap)
        return {
            "type": "principled",
            "base_color": colour,
            "roughness": _roughness(material, coordinates) if has_texture else material.roughness,
            "metallic": metallic,
            "sheen": material.sheen,
            "sheen_tint": 0.5,
            "clearcoat": material.coat,
            "clearcoat_gloss": 0.75,
            "specular": 0.5,
        }
    if material.has_varied_roughness:  # roughplastic takes no texture
        return _principled_coat(colour, _roughness(material, coordinates, is_squared=True))
    return rough_plastic(colour, max(material.roughness, _MIN_ROUGHNESS))


def _roughness(material: Glossy, coordinates: ScaledCoordinates, is_squared: bool = False) -> Any:
    """Return a number or a texture. is_squared: True for Mitsuba's principled BSDF, which squares it"""
    if any(layer.roughness for layer in material.wear):
        from flowsculpt.render.mitsuba import detail_textures  # needs a compiled variant

        bare = _roughness(replace(material, wear=()), coordinates)
        return detail_textures.detailed_roughness(bare, material.wear, is_squared)
    if material.pigment is not None and material.pigment.roughness:
        from flowsculpt.render.mitsuba.pattern_textures import pattern_texture  # needs a compiled variant

        return pattern_texture(material.pigment, "roughness", is_squared)
    if material.roughness_texture is None:
        return max(material.roughness, _MIN_ROUGHNESS)
    numbers = np.clip(material.roughness_texture.numbers(), _MIN_ROUGHNESS, 1.0)
    numbers = np.sqrt(numbers) if is_squared else numbers
    return bitmap(numbers, coordinates, material.projection, material.roughness_texture.wrap)
