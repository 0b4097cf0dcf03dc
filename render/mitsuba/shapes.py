"""Mitsuba's shapes: meshes, the stage and reference objects. Functions need a started engine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.materials import diffuse, rough_conductor, rough_plastic, two_sided, vertex_attribute
from render.mitsuba.texture_coordinates import SURROUNDINGS
from render.scene import reference_objects
from render.scene.camera import Camera
from render.scene.reference_objects import CHROME, GREY
from render.scene.stage import Mesh, Stage, StagePlacement
from render.scene.surface import Surface

PLINTH = (0.56, 0.555, 0.545)
"""Reflectance of a plinth: a white one would outshine the subject."""

_UV = np.array([0.0, SURROUNDINGS])


def mesh(
    name: str,
    surface: Surface,
    material: Any,
    uv: NDArray[np.floating],
    medium: dict[str, Any] | None = None,
) -> Any:
    """Return a mesh for a scene.

    material  a BSDF, or its description
    uv        texture coordinates (V, 2), or (2,) for all; see `render.mitsuba.texture_coordinates`
    medium    description of the medium inside, or None
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["material"] = mi.load_dict(material) if isinstance(material, dict) else material
    if medium is not None:
        properties["interior"] = mi.load_dict(medium)
    made = mi.Mesh(
        name,
        vertex_count=len(surface.vertices),
        face_count=len(surface.faces),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    values = mi.traverse(made)
    values["vertex_positions"] = _ravel(surface.vertices)
    values["vertex_normals"] = _ravel(surface.normals)
    values["vertex_texcoords"] = _ravel(np.broadcast_to(uv, (len(surface.vertices), 2)))
    values["faces"] = np.ascontiguousarray(surface.faces, dtype=np.uint32).ravel()
    values.update()
    for attribute, array in surface.attributes.items():
        made.add_attribute(f"vertex_{attribute}", array.shape[1], _ravel(array))
    return made


def _ravel(array: NDArray[Any]) -> Any:
    return np.ascontiguousarray(array, dtype=np.float32).ravel()


def stage_shapes(
    stage: Stage, placement: StagePlacement, camera: Camera, size: tuple[int, int]
) -> dict[str, Any]:
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


def auxiliary_stage_shapes(
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
