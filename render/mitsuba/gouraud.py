"""Pictures as they were drawn in 1990: a colour at each vertex, faces fill in between (Gouraud 1971).

One hard light without shadows, a white highlight, a gradient behind; no light is followed anywhere, so
there is no noise. What is drawn is what Mitsuba takes for the albedo.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba import vertex_colours as dyes
from render.mitsuba.mesh import mesh
from render.mitsuba.texture_coordinates import SUBJECT, SURROUNDINGS
from render.scene.camera import Camera
from render.scene.look import Look
from render.scene.stage import Placement
from render.scene.surface import Surface

Rows = NDArray[np.float64]

LIGHT = (-0.55, 0.62, 0.56)
"""Where the light comes from, stage axes."""

AMBIENT, DIFFUSE, HIGHLIGHT = 0.10, 0.95, 0.75
"""Shares of the light, each of a surface that meets it best."""

GROUND = ((0.012, 0.016, 0.10), (0.05, 0.05, 0.22), (0.42, 0.20, 0.34))
"""Colours behind the subject, from the top of the picture to the bottom."""

_NAME = "gouraud"


def shapes(
    surface: Surface, look: Look, placement: Placement, camera: Camera, size: tuple[int, int]
) -> dict[str, Any]:
    """The subject and what is behind it, as shapes whose albedo is the picture."""
    shaded = replace(surface, attributes={_NAME: colours(surface, look, placement, camera)})
    return {
        "subject": mesh("subject", shaded, _drawn(), np.array([0.0, SUBJECT])),
        "stage": mesh("stage", _behind(placement, camera, size), _drawn(), np.array([0.0, SURROUNDINGS])),
    }


def colours(surface: Surface, look: Look, placement: Placement, camera: Camera) -> NDArray[np.float32]:
    """(V, 3) linear Rec.709, 0 … 1: Lambert's law and Blinn's highlight (SIGGRAPH 1977) at each vertex."""
    light = placement.matrix()[:3, :3] @ np.array(LIGHT)
    light /= np.linalg.norm(light)
    eye = np.array(camera.origin) - surface.vertices
    eye /= np.linalg.norm(eye, axis=1, keepdims=True)
    normals = surface.normals.astype(np.float64)
    normals *= np.where((normals * eye).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]  # both sides are lit
    lit = np.clip(normals @ light, 0.0, 1.0)
    between = eye + light
    between /= np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-9)
    sharp = 2.0 / max(look.roughness, 0.05) ** 2
    shine = np.where(lit > 0.0, np.clip((normals * between).sum(axis=1), 0.0, 1.0) ** sharp, 0.0)
    body = _body(surface, look) * (AMBIENT + DIFFUSE * lit)[:, None]
    return np.asarray(np.clip(body + HIGHLIGHT * shine[:, None], 0.0, 1.0), dtype=np.float32)


def _body(surface: Surface, look: Look) -> Rows:
    found = dyes.colours(surface, look)
    return np.broadcast_to(np.array(look.colour), (len(surface.vertices), 3)) if found is None else found


def _behind(placement: Placement, camera: Camera, size: tuple[int, int]) -> Surface:
    """A wall across the view, behind everything and larger than the picture."""
    right, up, ahead = camera.axes()
    away = 4.0 * (math.dist(camera.origin, camera.target) + placement.size)
    wide = 1.02 * away * math.tan(camera.field_of_view / 2.0)
    rows = np.linspace(1.0, -1.0, len(GROUND)) * wide * size[1] / size[0]
    middle = camera.origin + away * ahead
    left_right = wide * np.stack([-right, right])
    vertices = (middle + rows[:, None, None] * up + left_right).reshape(-1, 3).astype(np.float32)
    first = 2 * np.arange(len(GROUND) - 1, dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])]).astype(np.int32)
    shown = np.repeat(np.array(GROUND, dtype=np.float32), 2, axis=0)
    normals = np.broadcast_to(-ahead, vertices.shape).astype(np.float32)
    return Surface(vertices, normals, faces, {_NAME: shown})


def _drawn() -> dict[str, Any]:
    colour = {"type": "mesh_attribute", "name": f"vertex_{_NAME}"}
    return {"type": "twosided", "material": {"type": "diffuse", "reflectance": colour}}
