"""Stages and reference objects as Mitsuba's shapes. Functions need a started engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from render.mitsuba.materials import diffuse, rough_conductor, rough_plastic, two_sided, vertex_attribute
from render.mitsuba.mesh import mesh
from render.mitsuba.texture_coordinates import SURROUNDINGS
from render.scene import reference_objects
from render.scene.camera import Camera
from render.scene.reference_objects import CHROME, GREY
from render.scene.stage import Mesh, Stage, StagePlacement
from render.scene.surface import Surface

PLINTH = (0.56, 0.555, 0.545)
"""Reflectance of a plinth: a white one would outshine the subject."""

_UV = np.array([0.0, SURROUNDINGS])


def shapes(stage: Stage, placement: StagePlacement, camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """Return the shapes around the subject by their names in the scene. size: of the picture, pixels"""
    if stage.kind == "none":
        return {}
    floor = diffuse(stage.colour) if stage.roughness is None else _coated(stage, stage.roughness)
    made = {"stage": mesh("stage", _placed(stage.backdrop(), placement), floor, _UV)}
    if stage.kind == "plinth":
        made["plinth"] = mesh("plinth", _placed(stage.plinth(), placement), diffuse(PLINTH), _UV)
    if stage.kind == "turntable":
        grey, chrome, chart = reference_objects.positions(camera, placement, size[0] / size[1])
        mirror = two_sided(rough_conductor({"type": "rgb", "value": CHROME}, 0.02))
        board = reference_objects.chart(chart, camera)
        made["grey"] = mesh("grey", reference_objects.ball(grey), diffuse((GREY,) * 3), _UV)
        made["chrome"] = mesh("chrome", reference_objects.ball(chrome), mirror, _UV)
        made["chart"] = mesh("chart", board, vertex_attribute("colour"), _UV)
    return made


def auxiliary_shapes(
    stage: Stage, placement: StagePlacement, camera: Camera, size: tuple[int, int]
) -> dict[str, Any]:
    """Return the shapes that differ in auxiliary AOVs: Mitsuba knows no albedo of a mirror."""
    if stage.kind != "turntable":
        return {}
    _, chrome, _ = reference_objects.positions(camera, placement, size[0] / size[1])
    return {"chrome": mesh("chrome", reference_objects.ball(chrome), diffuse((CHROME,) * 3), _UV)}


def _placed(stage_mesh: Mesh, placement: StagePlacement) -> Surface:
    vertices, normals, faces = stage_mesh
    to_scene = placement.matrix()
    linear = to_scene[:3, :3]
    moved = (vertices.astype(np.float64) @ linear.T + to_scene[:3, 3]).astype(np.float32)
    turned = (normals.astype(np.float64) @ linear.T / np.linalg.norm(linear[:, 1])).astype(np.float32)
    return Surface(moved, turned, faces)


def _coated(stage: Stage, roughness: float) -> dict[str, Any]:
    return two_sided(rough_plastic({"type": "rgb", "value": list(stage.colour)}, max(roughness, 1e-2)))
