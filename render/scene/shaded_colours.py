"""Shaded colours of vertices, for surfaces that are drawn as in 1990, without a path tracer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.scene.materials import Material
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.surface import Surface

Floats = NDArray[np.float64]

LIGHT = (-0.55, 0.62, 0.56)
"""Direction to the light, stage axes."""

AMBIENT, DIFFUSE, HIGHLIGHT = 0.10, 0.95, 0.75
"""Strengths of the three terms."""


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
    colours = material.vertex_colours(surface)
    body = np.array([material.colour]) if colours is None else colours
    body = body * (AMBIENT + DIFFUSE * lit)[:, None]
    return np.asarray(np.clip(body + HIGHLIGHT * shine[:, None], 0.0, 1.0), dtype=np.float32)
