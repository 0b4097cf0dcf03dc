"""Colours of vertices, for pictures without a path tracer: the material's, and shaded ones as in 1990.

The path tracer interpolates phases and looks up the colour ramp per sample (`render.mitsuba.materials`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.scene.materials import Material, Painted, PatternedMaterial
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.patterns import Measure, looked_up
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.textures import texels_at

Floats = NDArray[np.float64]

LIGHT = (-0.55, 0.62, 0.56)
"""Direction to the light, stage axes."""

AMBIENT, DIFFUSE, HIGHLIGHT = 0.10, 0.95, 0.75
"""Strengths of the three terms."""


def vertex_phases(surface: Surface, material: Material) -> Floats | None:
    """Return the phases (V,) of the material's pattern, or None for a material without one.

    Raises BadInputError where the surface lacks what the pattern needs.
    """
    pattern = material.pattern
    if pattern is None:
        return None
    if isinstance(pattern, Measure):
        return pattern.phases(surface)
    return pattern.phases(pattern.places(surface))


def vertex_colours(surface: Surface, material: Material) -> Floats | None:
    """Return linear Rec.709 reflectances (V, 3), or None for a material of one colour.

    Raises BadInputError where the surface lacks what the colours need.
    """
    if isinstance(material, Painted):
        return _painted_colours(surface, material)
    if isinstance(material, PatternedMaterial) and material.colour_texture is not None:
        return _texture_colours(surface, material)
    phases = vertex_phases(surface, material)
    if phases is None or material.pattern is None:
        return None
    return looked_up(material.pattern, phases)


def _painted_colours(surface: Surface, painted: Painted) -> Floats | None:
    """Return the colours of a model's materials at vertices; one with several takes that of some face."""
    colours, paint = np.empty((len(surface.vertices), 3)), surface.paint
    if paint is None:
        return None
    for number, part in enumerate(painted.parts):
        which = paint.materials == number
        if not which.any():
            continue
        faces, own = surface.faces[which], paint.of_faces(which)
        if part.colour_texture is not None:
            colours[faces] = _texture_colours(replace(surface, faces=faces, paint=own), part)[faces]
        else:
            dyed = own.colours is not None and part.colour_from == PaintedFaces.COLOURS
            colours[faces] = own.colours if dyed else part.colour
    return colours


def _texture_colours(surface: Surface, material: PatternedMaterial) -> Floats:
    """Return the texels at vertices; a vertex with two texture coordinates takes one of them."""
    rest = surface.require_rest("look has a picture")
    points = np.repeat(np.arange(len(rest), dtype=np.int32)[:, None], 3, axis=1)
    faces = surface.faces if len(surface.faces) else points
    corners, _ = material.projection.coordinates(rest, faces, surface.paint)
    coordinates = np.zeros((len(rest), 2))
    coordinates[faces.reshape(-1)] = corners.reshape(-1, 2)
    pixels, texture = material.colour_pixels(), material.colour_texture
    assert texture is not None
    height, width = pixels.shape[:2]
    right, up = material.projection.offset
    across = coordinates[:, 0] + 0.5 - right
    down = 0.5 + up - coordinates[:, 1] * (width / height if material.projection.keeps_shape else 1.0)
    return texels_at(pixels, across, down, texture.wrap).astype(np.float64)


def shaded_colours(
    surface: Surface, material: Material, placement: StagePlacement, camera: Camera
) -> NDArray[np.float32]:
    """Return linear Rec.709 colours (V, 3), 0 … 1: Lambert's law and Blinn's highlight (SIGGRAPH 1977).

    One hard light without shadows, and a white highlight. There is no light transport, so there is no noise.
    """
    light = placement.matrix()[:3, :3] @ np.array(LIGHT)
    light /= np.linalg.norm(light)
    eye = np.array(camera.origin) - surface.vertices
    eye /= np.linalg.norm(eye, axis=1, keepdims=True)
    normals = surface.normals.astype(np.float64)
    normals *= np.where((normals * eye).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]  # both sides are lit
    lit = np.clip(normals @ light, 0.0, 1.0)
    halfway = eye + light
    halfway /= np.maximum(np.linalg.norm(halfway, axis=1, keepdims=True), 1e-9)
    exponent = 2.0 / max(material.roughness, 0.05) ** 2
    shine = np.where(lit > 0.0, np.clip((normals * halfway).sum(axis=1), 0.0, 1.0) ** exponent, 0.0)
    colours = vertex_colours(surface, material)
    body = np.array([material.colour]) if colours is None else colours
    body = body * (AMBIENT + DIFFUSE * lit)[:, None]
    return np.asarray(np.clip(body + HIGHLIGHT * shine[:, None], 0.0, 1.0), dtype=np.float32)
