"""Mitsuba's shapes: meshes, the stage and reference objects. Functions need a started engine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.mitsuba.loading import load_bsdf
from flowsculpt.render.mitsuba.materials import (
    diffuse,
    rough_conductor,
    rough_plastic,
    two_sided,
    vertex_attribute,
)
from flowsculpt.render.mitsuba.texture_coordinates import SUBJECT, SURROUNDINGS
from flowsculpt.render.scene import reference_objects
from flowsculpt.render.scene.reference_objects import CHROME, GREY
from flowsculpt.render.scene.rgb_spaces import converted_pixels
from flowsculpt.render.scene.room_shapes import WINDOWS, window_frame
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_stage import WITH_REFERENCES
from flowsculpt.render.scene.shaded_colours import shaded_colours
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.surface_detail import FINISHES

BACKGROUND = ((0.012, 0.016, 0.10), (0.05, 0.05, 0.22), (0.42, 0.20, 0.34))
"""Colours behind the subject, from the top of the picture to the bottom."""

_UV = np.array([0.0, SURROUNDINGS])


def mesh(
    name: str, surface: Surface, material: Any, uv: NDArray[np.floating], medium: dict[str, Any] | None = None
) -> Any:
    """Return a mesh for a scene.

    material  a BSDF, or its description
    uv        texture coordinates (V, 2), or (2,) for all; see `flowsculpt.render.mitsuba.texture_coordinates`
    medium    description of the medium inside, or None
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["material"] = load_bsdf(name, material) if isinstance(material, dict) else material
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
    values["vertex_positions"] = aligned(surface.vertices, np.float32)
    values["vertex_normals"] = aligned(_normals(surface), np.float32)
    values["vertex_texcoords"] = aligned(np.broadcast_to(uv, (len(surface.vertices), 2)), np.float32)
    values["faces"] = aligned(surface.faces, np.uint32)
    values.update()
    for attribute, array in surface.attributes.items():
        made.add_attribute(f"vertex_{attribute}", array.shape[1], aligned(array, np.float32))
    return made


def _normals(surface: Surface) -> NDArray[np.floating]:
    """Return normals (V, 3); faces that flows have left without any get their own, else Mitsuba's is NaN."""
    known = np.logical_or.reduce(surface.normals, axis=1)
    bare = surface.faces[:0] if known.all() else surface.faces[~known[surface.faces].any(axis=1)]
    a, b, c = surface.vertices[bare.T].astype(np.float64)
    normals, across = surface.normals.astype(np.float32), np.cross(b - a, c - a)
    normals[bare] = (across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None])[:, None]
    return normals


def stage_shapes(scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    """Return the shapes around the subject by their names in the scene.

    scene  its stage's colour is in the working space; colours that are the same on every stage are converted
           here
    size   of the picture, pixels
    """
    stage, placement, camera, space = scene.stage, scene.placement, scene.camera, scene.working_space
    if stage.kind == "none":
        return {}
    made = {"stage": _backdrop(scene)}
    if (plinth := stage.plinth()) is not None:
        surface = Surface(*placement.placed(plinth), rest=plinth[0])
        colour = {"type": "rgb", "value": list(stage.plinth_colour)}
        made["plinth"] = _part("plinth", surface, colour, stage.plinth_coat, stage.plinth_finish)
    if stage.kind in WINDOWS:
        frame = Surface(*placement.placed(window_frame(WINDOWS[stage.kind])))
        made["window"] = mesh("window", frame, two_sided(diffuse(stage.plinth_colour)), _UV)
    if stage.kind == WITH_REFERENCES:
        grey, chrome, chart = reference_objects.positions(camera, placement, size[0] / size[1])
        mirror = two_sided(rough_conductor({"type": "rgb", "value": CHROME}, 0.02))
        board = reference_objects.chart(chart, camera)
        board = replace(
            board, attributes={"colour": converted_pixels(board.attributes["colour"], space.name)}
        )
        made["grey"] = mesh("grey", reference_objects.ball(grey), diffuse((GREY,) * 3), _UV)
        made["chrome"] = mesh("chrome", reference_objects.ball(chrome), mirror, _UV)
        made["chart"] = mesh("chart", board, vertex_attribute("colour"), _UV)
    return made


def _backdrop(scene: Scene) -> Any:
    """Return floor and wall."""
    stage = scene.stage
    surface = Surface(*scene.placement.placed(stage.backdrop()), rest=stage.backdrop()[0])
    colour: dict[str, Any] = {"type": "rgb", "value": list(stage.colour)}
    if scene.stage_fades or stage.is_graded:
        surface = replace(surface, attributes={"colour": stage.reflectances(scene.stage_fades)})
        colour = {"type": "mesh_attribute", "name": "vertex_colour"}
    if stage.horizon_fade:
        there = stage.opacity_at(stage.backdrop()[0])[:, None]
        surface = replace(surface, attributes={**surface.attributes, "there": there})
    return _part("stage", surface, colour, stage.coat, stage.finish)


def _part(name: str, surface: Surface, colour: dict[str, Any], coat: float | None, finish: str) -> Any:
    """Return a part of a stage, with the detail of its finish, if it has one.

    surface  at rest in stage units
    coat     roughness of its coat, or None
    """
    if not (finish and is_compiled()):
        return mesh(name, surface, _coat(colour, coat), _UV)
    from flowsculpt.render.mitsuba import detail_textures  # needs a compiled variant

    layers = FINISHES[finish][1]
    shown = detail_textures.detailed_colour(colour, layers)
    if coat is None:
        body: dict[str, Any] = {"type": "diffuse", "reflectance": shown}
    else:
        gloss = detail_textures.detailed_roughness(float(coat), layers, is_rooted=True)
        body = {"type": "principled", "base_color": shown, "roughness": gloss, "specular": 0.5}
    made = {"type": "normalmap", "normalmap": detail_textures.detail_normals(layers), "body": two_sided(body)}
    return mesh(name, detail_textures.with_detail_places(surface), made, _UV)


def _coat(colour: dict[str, Any], roughness: float | None) -> dict[str, Any]:
    """Return a matt BSDF of both sides, under a clear coat where there is a roughness of one."""
    if roughness is None:
        return two_sided({"type": "diffuse", "reflectance": colour})
    return two_sided(rough_plastic(colour, max(roughness, 1e-2)))


def auxiliary_stage_shapes(scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    """Return the shapes that differ in auxiliary AOVs: Mitsuba knows no albedo of a mirror."""
    if scene.stage.kind != WITH_REFERENCES:
        return {}
    _, chrome, _ = reference_objects.positions(scene.camera, scene.placement, size[0] / size[1])
    return {"chrome": mesh("chrome", reference_objects.ball(chrome), diffuse((CHROME,) * 3), _UV)}


def gouraud_shapes(scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    """Return the subject and a background, whose albedo is the picture: vertex colours (Gouraud 1971).

    Shading as in 1990 clips colours in Rec.709; they are then converted to the working space.
    """
    surface = scene.subjects[0].surface
    colours = shaded_colours(surface, scene.material, scene.placement, scene.camera)
    shaded = replace(surface, attributes={"shaded": converted_pixels(colours, scene.working_space.name)})
    background, colour = _gouraud_backdrop(scene, size), vertex_attribute("shaded")
    return {
        "subject": mesh("subject", shaded, colour, np.array([0.0, SUBJECT])),
        "stage": mesh("stage", background, colour, _UV),
    }


def _gouraud_backdrop(scene: Scene, size: tuple[int, int]) -> Surface:
    """Return a wall across the view, behind everything and larger than the picture."""
    camera = scene.camera
    right, up, forward = camera.axes()
    distance = 4.0 * (math.dist(camera.origin, camera.target) + scene.placement.size)
    wide = 1.02 * distance * math.tan(camera.field_of_view / 2.0)
    rows = np.linspace(1.0, -1.0, len(BACKGROUND)) * wide * size[1] / size[0]
    middle = camera.origin + distance * forward
    left_right = wide * np.stack([-right, right])
    vertices = (middle + rows[:, None, None] * up + left_right).reshape(-1, 3).astype(np.float32)
    first = 2 * np.arange(len(BACKGROUND) - 1, dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])]).astype(np.int32)
    colours = converted_pixels(np.array(BACKGROUND, dtype=np.float32), scene.working_space.name)
    normals = np.broadcast_to(-forward, vertices.shape).astype(np.float32)
    return Surface(vertices, normals, faces, {"shaded": np.repeat(colours, 2, axis=0)})
