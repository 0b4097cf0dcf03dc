"""A surface, a look, lights and a camera become a Mitsuba scene.

An engine must have been started (`render.engine.Engine.start`) before anything here is called.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import absorption, gouraud, lamps, wireframe
from render import material as materials
from render.camera import Camera
from render.lights import LightRig
from render.look import Look
from render.marks import SUBJECT, SURROUNDINGS, marks
from render.mitsuba_mesh import mesh
from render.sensor import sensor
from render.stage import Placement, Stage
from render.surface import Surface

_CHANGING = ("to_world", "medium.scale", absorption.RATE)
"""How the names of values end that differ from frame to frame."""

BLOCK_SIZE = 16
"""Pixels along a block of the scalar variant. Each block has its own random numbers, and left alone Mitsuba
cuts the picture by the number of threads."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """A Mitsuba scene, and what Mitsuba should find out about it."""

    scene: Any
    integrator: Any


def build_scene(
    surface: Surface,
    look: Look,
    lights: LightRig,
    stage: Stage,
    placement: Placement,
    camera: Camera,
    size: tuple[int, int],
    depth: int,
) -> tuple[Rendering, Rendering]:
    """What to render for the beauty and for the AOVs. `size` is width and height in pixels.

    Lamps are hidden from the lens in the beauty, but AOVs would show them: where a lamp stands in the
    picture they get a scene of their own without it. Raises BadInputError for a surface or a look that
    cannot be rendered.
    """
    surface.check()
    if look.model == "gouraud":
        return _drawn(surface, look, placement, camera, size)
    told = marks(surface, look)
    made_of = materials.material(look, surface.attributes, told, placement.size)
    subject = mesh("subject", surface, made_of, told.values, materials.medium(look, placement.size))
    shapes = {"subject": subject}
    to_scene = placement.matrix()
    if stage.kind == "cyclorama":
        shapes["stage"] = _cyclorama(stage, to_scene)
    if look.wireframe:
        shapes["wireframe"] = _wires(surface, look.wireframe, camera, size)
    common = {"type": "scene", "sensor": sensor(camera, size), **shapes}
    lit = {**common, **lamps.emitters(lights, to_scene)}
    scene = _load(lit)
    bare = scene
    if look.is_clear:
        bare = _load({**common, "subject": mesh("subject", surface, materials.guide(look), told.values)})
    elif lamps.any_in_view(lights, to_scene, camera, size):
        bare = _load(common)
    beauty = _integrator(_beauty(materials.path(look, depth), lights))
    return Rendering(scene, beauty), Rendering(bare, _integrator(_aovs()))


def _drawn(
    surface: Surface, look: Look, placement: Placement, camera: Camera, size: tuple[int, int]
) -> tuple[Rendering, Rendering]:
    """A look that brings its own light and its own stage."""
    shapes = gouraud.shapes(surface, look, placement, camera, size)
    if look.wireframe:
        shapes["wireframe"] = _wires(surface, look.wireframe, camera, size)
    scene = _load({"type": "scene", "sensor": sensor(camera, size), **shapes})
    beauty = {"type": "aov", "aovs": "albedo:albedo", "block_size": BLOCK_SIZE}
    return Rendering(scene, _integrator(beauty)), Rendering(scene, _integrator(_aovs()))


def _wires(surface: Surface, drawn: wireframe.Wireframe, camera: Camera, size: tuple[int, int]) -> Any:
    lines = wireframe.ribbons(surface, drawn, camera, size[0])
    return mesh("wireframe", lines, drawn.material(), np.array([0.0, SUBJECT]))


def _integrator(description: dict[str, Any]) -> Any:
    import mitsuba as mi

    return mi.load_dict(description, parallel=False, optimize=False)


def _load(scene: dict[str, Any]) -> Any:
    """Load a scene in the order it is written.

    Mitsuba's optimizer merges shapes by where their materials happen to lie in memory; lamps then change
    places from one run to the next, and with them the noise.
    """
    import mitsuba as mi

    loaded = mi.load_dict(scene, parallel=False, optimize=False)
    if mi.variant() != "scalar_rgb":
        _keep_out_of_kernels(loaded)
    return loaded


def _keep_out_of_kernels(scene: Any) -> None:
    """Make where things stand, and how dense they are, data of the compiled code, not constants in it.

    Otherwise every frame whose stage moves or grows a little is compiled anew, which takes a third of a
    second and a place on the disk.
    """
    import drjit as dr
    import mitsuba as mi

    values = mi.traverse(scene)
    for name in [name for name in values.keys() if name.endswith(_CHANGING)]:  # noqa: SIM118 not a dict
        dr.make_opaque(values[name])
        values[name] = values[name]
    values.update()


def _beauty(path: dict[str, Any], lights: LightRig) -> dict[str, Any]:
    return {**path, "hide_emitters": not lights.sky.visible, "block_size": BLOCK_SIZE}


def _aovs() -> dict[str, Any]:
    wanted = "albedo:albedo,depth:depth,position:position,normal:sh_normal,matte:uv"
    return {"type": "aov", "aovs": wanted, "block_size": BLOCK_SIZE}


def _cyclorama(stage: Stage, to_scene: NDArray[np.float64]) -> Any:
    vertices, normals, faces = stage.mesh()
    linear = to_scene[:3, :3]
    moved = (vertices.astype(np.float64) @ linear.T + to_scene[:3, 3]).astype(np.float32)
    turned = (normals.astype(np.float64) @ linear.T / np.linalg.norm(linear[:, 1])).astype(np.float32)
    material = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(stage.colour)}}
    two_sided = {"type": "twosided", "material": material}
    return mesh("stage", Surface(moved, turned, faces), two_sided, np.array([0.0, SURROUNDINGS]))
