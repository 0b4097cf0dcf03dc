"""Materials of exported files: the preview surfaces of a look, with the pictures that glTF and pages hold.

A picture of numbers has roughness in green and metalness in blue, as glTF has them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flowsculpt.api.materials import Material, PaintedFaces, Satin, Texture
from flowsculpt.pipeline.plugins.interchange.embedded_pictures import EmbeddedPicture

COMPACT = 2048
"""The most pixels along a side of pictures in compressed files; finer ones are averaged."""


class ExportedMaterial(NamedTuple):
    """A material of a file.

    surface      its colour, roughness and metalness are factors on the pictures
    colour       the picture of its colour, or None
    numbers      the picture of roughness and metalness, or None
    is_coloured  True if the colours of vertices, where there are any, take the place of the surface's
    normals      the picture of normals in the space of tangents, green up, or None
    bump         the factor on the slope of its normals
    is_cut_out   True if the alpha of its colours, times its opacity, is what is there of it
    cutoff       from which alpha on all is there, and below nothing; None for a fraction
    """

    surface: Any
    colour: EmbeddedPicture | None
    numbers: EmbeddedPicture | None
    is_coloured: bool
    normals: EmbeddedPicture | None = None
    bump: float = 1.0
    is_cut_out: bool = False
    cutoff: float | None = None

    @property
    def has_pictures(self) -> bool:
        """True if faces need texture coordinates."""
        return any((self.colour, self.numbers, self.normals))


def exported_materials(look: Material, widest: int = Texture.WIDEST) -> tuple[ExportedMaterial, ...]:
    """Return the materials of a look: those of a model by their numbers, of other looks one.

    widest  the most pixels along a side of a picture

    Raises as `read_picture`.
    """
    return tuple(_export(part, look.is_of_model, widest) for part in look.parts_by_number)


def pictures_recipe(look: Material) -> list[str]:
    """Return what keys of files with pictures, or several materials, hold; nothing for other looks."""
    names, parts = ("colour", "roughness", "metallic", "normal"), look.parts_by_number
    held = len(parts) > 1 or any(part.opacity or any(map(part.texture, names)) for part in parts)
    return ["pictures"] if held else []


def number_planes(part: Material) -> dict[str, np.ndarray]:
    """Return the pictures (H, W, 1) of roughness and metalness of a material as preview surfaces have them,
    by name. Raises as `read_picture`."""
    planes: dict[str, np.ndarray] = {}
    for name in ("roughness", "metallic"):
        texture = part.texture(name)
        if texture is not None and _fits(part):
            planes[name] = np.clip(texture.numbers(), 0.0, 1.0)
    if "roughness" in planes and not isinstance(part, Satin):  # that of others is the width of the lobe
        planes["roughness"] = np.sqrt(planes["roughness"])
    return planes


def _export(part: Material, is_of_model: bool, widest: int) -> ExportedMaterial:
    numbers, surface = _numbers(part, part.preview_surface(), widest)
    texture = part.texture("colour")
    bumps = part.texture("normal")
    picture = normals = None
    is_coloured = not is_of_model or getattr(part, "colour_from", None) == PaintedFaces.COLOURS
    if texture is not None:
        picture, is_coloured = EmbeddedPicture.of_texture(texture, widest, is_colour=True), False
        surface = surface._replace(colour=texture.factor)
    if bumps is not None:
        normals = EmbeddedPicture.of_texture(bumps, widest, is_colour=False)
    bump = 1.0 if bumps is None else bumps.factor[0]
    opacity = part.opacity
    if opacity is None:
        return ExportedMaterial(surface, picture, numbers, is_coloured, normals, bump)
    if opacity.texture is not None:
        picture = _with_alpha(part, opacity.texture, widest)
    return ExportedMaterial(
        surface, picture, numbers, is_coloured, normals, bump, is_cut_out=True, cutoff=opacity.cutoff
    )


def _with_alpha(part: Material, mask: Texture, widest: int) -> EmbeddedPicture:
    """Return the colours of a material, white without a picture, with an alpha."""
    wrap = (part.texture("colour") or mask).wrap
    return EmbeddedPicture.with_alpha(part.colour_pixels(with_factor=False), mask.numbers(), widest, wrap)


def _numbers(part: Material, surface: Any, widest: int) -> tuple[EmbeddedPicture | None, Any]:
    """Return the picture of roughness and metalness, if there is one, and the surface with factors on it."""
    rough = part.texture("roughness")
    metal = part.texture("metallic")
    planes = number_planes(part)
    if not planes:
        return None, surface
    if rough and metal and (rough.digest, rough.channel, metal.channel) == (metal.digest, 1, 2):
        factors = surface._replace(roughness=rough.factor[1], metallic=metal.factor[2])
        return EmbeddedPicture.of_texture(rough, widest, is_colour=False), factors
    held = [None, planes.get("roughness"), planes.get("metallic")]
    roughness = 1.0 if "roughness" in planes else surface.roughness
    metallic = 1.0 if "metallic" in planes else surface.metallic
    wrap = next(texture.wrap for texture in (rough, metal) if texture is not None)
    factors = surface._replace(roughness=roughness, metallic=metallic)
    return EmbeddedPicture.of_numbers(held, widest, wrap), factors


def _fits(part: Material) -> bool:
    """Tell whether pictures of roughness and metalness cover a surface by the coordinates of its colours.

    Where a projection keeps their shape, those of another shape than the colours would need others.
    """
    projection = part.texture_projection
    if projection is None or not projection.keeps_shape:
        return True
    colour = part.texture("colour")
    shape = (1, 1) if colour is None else colour.pixels().shape[:2]
    held = (part.texture(name) for name in ("roughness", "metallic"))
    shapes = [texture.numbers().shape[:2] for texture in held if texture is not None]
    return all(shape[0] * width == shape[1] * height for height, width in shapes)
