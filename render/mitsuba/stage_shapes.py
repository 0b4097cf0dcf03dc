"""A stage as Mitsuba's shapes. An engine must have been started before anything here is called."""

from __future__ import annotations

from typing import Any

import numpy as np

from render.base.serialise import Triple
from render.mitsuba.mesh import mesh
from render.mitsuba.texture_coordinates import SURROUNDINGS
from render.scene import reference_objects as set_pieces
from render.scene.camera import Camera
from render.scene.stage import Mesh, Placement, Stage
from render.scene.surface import Surface

PLINTH = (0.56, 0.555, 0.545)
"""What a plinth reflects: a white one outshines what stands on it."""

_MARK = np.array([0.0, SURROUNDINGS])


def shapes(stage: Stage, placement: Placement, camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """All that stands around the subject, by the names it has in the scene. size: of the picture, pixels"""
    if stage.kind == "none":
        return {}
    floor = _matt(stage.colour) if stage.roughness is None else _coated(stage.colour, stage.roughness)
    made = {"stage": mesh("stage", _placed(stage.backdrop(), placement), floor, _MARK)}
    if stage.kind == "plinth":
        made["plinth"] = mesh("plinth", _placed(stage.plinth(), placement), _matt(PLINTH), _MARK)
    if stage.kind == "turntable":
        grey, chrome, chart = set_pieces.spots(camera, placement, size[0] / size[1])
        painted = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_colour"}}
        board = {"type": "twosided", "material": painted}
        made["grey"] = mesh("grey", set_pieces.ball(grey), _matt((set_pieces.GREY,) * 3), _MARK)
        made["chrome"] = mesh("chrome", set_pieces.ball(chrome), _mirror(), _MARK)
        made["chart"] = mesh("chart", set_pieces.chart(chart, camera), board, _MARK)
    return made


def guides(stage: Stage, placement: Placement, camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """Those shapes that AOVs have otherwise: a mirror has no albedo that Mitsuba could tell."""
    if stage.kind != "turntable":
        return {}
    _, chrome, _ = set_pieces.spots(camera, placement, size[0] / size[1])
    return {"chrome": mesh("chrome", set_pieces.ball(chrome), _matt((set_pieces.CHROME,) * 3), _MARK)}


def _placed(made: Mesh, placement: Placement) -> Surface:
    vertices, normals, faces = made
    to_scene = placement.matrix()
    linear = to_scene[:3, :3]
    moved = (vertices.astype(np.float64) @ linear.T + to_scene[:3, 3]).astype(np.float32)
    turned = (normals.astype(np.float64) @ linear.T / np.linalg.norm(linear[:, 1])).astype(np.float32)
    return Surface(moved, turned, faces)


def _matt(colour: Triple) -> dict[str, Any]:
    material = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}
    return {"type": "twosided", "material": material}


def _coated(colour: Triple, roughness: float) -> dict[str, Any]:
    material = {
        "type": "roughplastic",
        "diffuse_reflectance": {"type": "rgb", "value": list(colour)},
        "alpha": max(roughness, 1e-2),
        "distribution": "ggx",
        "nonlinear": True,
    }
    return {"type": "twosided", "material": material}


def _mirror() -> dict[str, Any]:
    material = {
        "type": "roughconductor",
        "material": "none",
        "specular_reflectance": {"type": "rgb", "value": set_pieces.CHROME},
        "alpha": 0.02,
        "distribution": "ggx",
    }
    return {"type": "twosided", "material": material}
