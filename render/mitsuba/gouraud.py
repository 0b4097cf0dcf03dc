"""Gouraud shading, as in the film of 1990: a colour at each vertex, interpolated over faces (Gouraud 1971).

One hard light without shadows, a white highlight, a gradient behind. There is no light transport, so there
is no noise. The picture is the albedo AOV.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.materials import vertex_attribute
from render.mitsuba.shapes import mesh
from render.mitsuba.texture_coordinates import SUBJECT, SURROUNDINGS
from render.scene.camera import Camera
from render.scene.materials import Material
from render.scene.stage import StagePlacement
from render.scene.surface import Surface
from render.scene.vertex_colours import vertex_colours

Floats = NDArray[np.float64]

LIGHT = (-0.55, 0.62, 0.56)
"""Direction to the light, stage axes."""

AMBIENT, DIFFUSE, HIGHLIGHT = 0.10, 0.95, 0.75
"""Strengths of the three terms."""

BACKGROUND = ((0.012, 0.016, 0.10), (0.05, 0.05, 0.22), (0.42, 0.20, 0.34))
"""Colours behind the subject, from the top of the picture to the bottom."""

_NAME = "gouraud"


def shapes(
    surface: Surface, material: Material, placement: StagePlacement, camera: Camera, size: tuple[int, int]
) -> dict[str, Any]:
    """Return the subject and the background as shapes whose albedo is the picture."""
    shaded = replace(surface, attributes={_NAME: shaded_colours(surface, material, placement, camera)})
    return {
        "subject": mesh("subject", shaded, vertex_attribute(_NAME), np.array([0.0, SUBJECT])),
        "stage": mesh(
            "stage",
            _backdrop(placement, camera, size),
            vertex_attribute(_NAME),
            np.array([0.0, SURROUNDINGS]),
        ),
    }


def shaded_colours(
    surface: Surface, material: Material, placement: StagePlacement, camera: Camera
) -> NDArray[np.float32]:
    """Return linear Rec.709 colours (V, 3), 0 … 1: Lambert's law and Blinn's highlight (SIGGRAPH 1977)."""
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
    body = _body(surface, material) * (AMBIENT + DIFFUSE * lit)[:, None]
    return np.asarray(np.clip(body + HIGHLIGHT * shine[:, None], 0.0, 1.0), dtype=np.float32)


def _body(surface: Surface, material: Material) -> Floats:
    colours = vertex_colours(surface, material)
    return (
        np.broadcast_to(np.array(material.colour), (len(surface.vertices), 3)) if colours is None else colours
    )


def _backdrop(placement: StagePlacement, camera: Camera, size: tuple[int, int]) -> Surface:
    """Return a wall across the view, behind everything and larger than the picture."""
    right, up, forward = camera.axes()
    distance = 4.0 * (math.dist(camera.origin, camera.target) + placement.size)
    wide = 1.02 * distance * math.tan(camera.field_of_view / 2.0)
    rows = np.linspace(1.0, -1.0, len(BACKGROUND)) * wide * size[1] / size[0]
    middle = camera.origin + distance * forward
    left_right = wide * np.stack([-right, right])
    vertices = (middle + rows[:, None, None] * up + left_right).reshape(-1, 3).astype(np.float32)
    first = 2 * np.arange(len(BACKGROUND) - 1, dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])]).astype(np.int32)
    colours = np.repeat(np.array(BACKGROUND, dtype=np.float32), 2, axis=0)
    normals = np.broadcast_to(-forward, vertices.shape).astype(np.float32)
    return Surface(vertices, normals, faces, {_NAME: colours})
