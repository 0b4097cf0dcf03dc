"""Materials of exported files: the preview surfaces of a look, with the pictures that glTF and pages hold.

A picture of numbers has roughness in green and metalness in blue, as glTF has them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flowsculpt.api.materials import (
    EmbeddedPicture,
    Opacity,
    PatternedMaterial,
    Satin,
    Texture,
)
from flowsculpt.api.pictures import Material, Painted, PaintedFaces
from flowsculpt.pipeline.plugins.interchange.preview_surfaces import PreviewSurface, preview_surface

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

    surface: PreviewSurface
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
    return tuple(_exported(part, isinstance(look, Painted), widest) for part in parts_of(look))


def pictures_recipe(look: Material) -> list[str]:
    """Return what keys of files with pictures, or several materials, hold; nothing for other looks."""
    names = ("colour_texture", "roughness_texture", "metallic_texture", "normal_texture", "opacity")
    parts = parts_of(look)
    held = len(parts) > 1 or any(getattr(part, name, None) for part in parts for name in names)
    return ["pictures"] if held else []


def number_planes(part: Material) -> dict[str, np.ndarray]:
    """Return the pictures (H, W, 1) of roughness and metalness of a material as preview surfaces have them,
    by name. Raises as `read_picture`."""
    planes: dict[str, np.ndarray] = {}
    for name in ("roughness", "metallic"):
        texture: Texture | None = getattr(part, f"{name}_texture", None)
        if texture is not None and _fits(part):
            planes[name] = np.clip(texture.numbers(), 0.0, 1.0)
    if "roughness" in planes and not isinstance(part, Satin):  # that of others is the width of the lobe
        planes["roughness"] = np.sqrt(planes["roughness"])
    return planes


def parts_of(look: Material) -> tuple[Material, ...]:
    """Return the materials of a model by their numbers; of other looks, the look."""
    return look.parts or (look,) if isinstance(look, Painted) else (look,)


def _exported(part: Material, is_of_model: bool, widest: int) -> ExportedMaterial:
    numbers, surface = _numbers(part, preview_surface(part), widest)
    texture: Texture | None = getattr(part, "colour_texture", None)
    bumps: Texture | None = getattr(part, "normal_texture", None)
    picture = normals = None
    is_coloured = not is_of_model or getattr(part, "colour_from", None) == PaintedFaces.COLOURS
    if texture is not None:
        picture, is_coloured = EmbeddedPicture.of_texture(texture, widest, is_colour=True), False
        surface = surface._replace(colour=texture.factor)
    if bumps is not None:
        normals = EmbeddedPicture.of_texture(bumps, widest, is_colour=False)
    bump = 1.0 if bumps is None else bumps.factor[0]
    opacity: Opacity | None = getattr(part, "opacity", None)
    if opacity is None:
        return ExportedMaterial(surface, picture, numbers, is_coloured, normals, bump)
    if opacity.texture is not None:
        picture = _with_alpha(part, opacity.texture, widest)
    return ExportedMaterial(
        surface, picture, numbers, is_coloured, normals, bump, is_cut_out=True, cutoff=opacity.cutoff
    )


def _with_alpha(part: Material, mask: Texture, widest: int) -> EmbeddedPicture:
    """Return the colours of a material, white without a picture, with an alpha."""
    colours = np.ones((1, 1, 3), np.float32)
    if isinstance(part, PatternedMaterial) and part.colour_texture is not None:
        plain = replace(part.colour_texture, factor=(1.0, 1.0, 1.0))
        colours = replace(part, colour_texture=plain).colour_pixels()
    wrap = (getattr(part, "colour_texture", None) or mask).wrap
    return EmbeddedPicture.with_alpha(colours, mask.numbers(), widest, wrap)


def _numbers(
    part: Material, surface: PreviewSurface, widest: int
) -> tuple[EmbeddedPicture | None, PreviewSurface]:
    """Return the picture of roughness and metalness, if there is one, and the surface with factors on it."""
    rough: Texture | None = getattr(part, "roughness_texture", None)
    metal: Texture | None = getattr(part, "metallic_texture", None)
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
    colour: Texture | None = getattr(part, "colour_texture", None)
    shape = (1, 1) if colour is None else colour.pixels().shape[:2]
    held = (getattr(part, name, None) for name in ("roughness_texture", "metallic_texture"))
    shapes = [texture.numbers().shape[:2] for texture in held if texture is not None]
    return all(shape[0] * width == shape[1] * height for height, width in shapes)
