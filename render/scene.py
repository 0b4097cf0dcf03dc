"""Arrays, a look, lights and a camera become a Mitsuba scene. The one module that knows Mitsuba's meshes.

An engine must have been started (`render.engine.Engine.start`) before anything here is called.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import material as materials
from render.camera import Camera
from render.errors import BadInputError
from render.lights import LightRig, Sky, Softbox, Sun
from render.look import Look
from render.stage import Placement, Stage

SUBJECT, SURROUNDINGS = 1.0, 0.0
"""The second texture coordinate of every vertex: averaged over a pixel it is the matte. The first is the
phase of the look's pigment."""

_CHANGING = ("to_world", "medium.scale")
"""How the names of values end that differ from frame to frame."""

BLOCK_SIZE = 16
"""Pixels along a block of the scalar variant. Each block has its own random numbers, and left alone Mitsuba
cuts the picture by the number of threads."""


@dataclass(frozen=True, eq=False)
class Surface:
    """What is rendered: vertices split at creases, with their normals.

    vertices    float32 (V, 3), scene units
    normals     float32 (V, 3), unit length
    faces       int32 (F, 3), counter-clockwise seen from outside
    attributes  by name, float32 (V, k)
    material    float32 (V, 3), where its points were before anything moved them; pigments need it
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    attributes: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    material: NDArray[np.float32] | None = None

    def check(self) -> None:
        """Raises BadInputError for what Mitsuba would render wrongly, or crash on, without a word."""
        count = len(self.vertices)
        if not count or not len(self.faces):
            raise BadInputError("the surface is empty; it needs at least one triangle")
        for name, array in (("vertices", self.vertices), ("normals", self.normals)):
            if array.shape != (count, 3):
                raise BadInputError(f"the surface's {name} have shape {array.shape}; not ({count}, 3)")
            bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if len(bad):
                raise BadInputError(
                    f"the surface's {name} are not finite at vertex {bad[0]} and {len(bad) - 1} others; "
                    "the flow must keep them finite"
                )
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise BadInputError(f"the surface's faces have shape {self.faces.shape}; they must be (F, 3)")
        if self.faces.min() < 0 or self.faces.max() >= count:
            raise BadInputError(
                f"a face names vertex {int(self.faces.max())} or {int(self.faces.min())}; there are {count}"
            )
        for name, array in self.attributes.items():
            if array.ndim != 2 or len(array) != count or not np.isfinite(array).all():
                raise BadInputError(f"attribute {name!r} must be finite and have shape ({count}, k)")
        if self.material is not None and (
            self.material.shape != (count, 3) or not np.isfinite(self.material).all()
        ):
            raise BadInputError(f"the surface's material must be finite and have shape ({count}, 3)")

    def phases(self, look: Look) -> NDArray[np.float64]:
        """(V,): of the look's pigment, 0 where it has none."""
        if look.pigment is None:
            return np.zeros(len(self.vertices))
        if self.material is None:
            raise BadInputError(
                "look has a pigment, and the surface does not say where its points were; give it material"
            )
        return look.pigment.phases(self.material)


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
    subject = _subject(surface, look, materials.material(look, surface.attributes), placement.size)
    shapes = {"subject": subject}
    to_scene = placement.matrix()
    if stage.kind == "cyclorama":
        shapes["stage"] = _cyclorama(stage, to_scene)
    common = {"type": "scene", "sensor": _sensor(camera, size), **shapes}
    lit = dict(common)
    for index, softbox in enumerate(lights.softboxes):
        lit[f"softbox{index}"] = _softbox(softbox, to_scene)
    for index, sun in enumerate(lights.suns):
        lit[f"sun{index}"] = _sun(sun, to_scene)
    lit["sky"] = _sky(lights.sky)
    scene = _load(lit)
    bare = scene
    if look.is_clear:
        bare = _load({**common, "subject": _subject(surface, look, materials.guide(look))})
    elif any(_in_view(lamp, to_scene, camera, size) for lamp in lights.softboxes):
        bare = _load(common)
    beauty = _integrator(_beauty(materials.path(look, depth), lights))
    return Rendering(scene, beauty), Rendering(bare, _integrator(_aovs()))


def _in_view(lamp: Softbox, to_scene: NDArray[np.float64], camera: Camera, size: tuple[int, int]) -> bool:
    """Whether a lamp may stand in the picture: no side of the view has all of a cube around it outside."""
    reach = math.hypot(lamp.width, lamp.height) / 2.0
    corners = np.array(list(itertools.product((-reach, reach), repeat=3))) + lamp.position
    seen = (corners @ to_scene[:3, :3].T + to_scene[:3, 3] - camera.origin) @ camera.axes().T
    right, up, depth = seen.T
    across = math.tan(camera.field_of_view / 2.0) * depth
    upwards = across * size[1] / size[0]
    outside = (right > across, right < -across, up > upwards, up < -upwards, depth < 0.0)
    return not any(side.all() for side in outside)


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


def _subject(surface: Surface, look: Look, material: dict[str, Any], size: float | None = None) -> Any:
    """The sculpture; with its half-size, filled with what the look fills it with."""
    filling = None if size is None else materials.medium(look, size)
    marks = np.stack([surface.phases(look), np.full(len(surface.vertices), SUBJECT)], axis=1)
    return _mesh("subject", surface, material, marks, filling)


def _mesh(
    name: str,
    surface: Surface,
    material: dict[str, Any],
    marks: NDArray[np.floating],
    filling: dict[str, Any] | None = None,
) -> Any:
    """marks: (V, 2) texture coordinates, or one for all; see SUBJECT"""
    import mitsuba as mi

    properties = mi.Properties()
    properties["material"] = mi.load_dict(material)
    if filling is not None:
        properties["interior"] = mi.load_dict(filling)
    mesh = mi.Mesh(
        name,
        vertex_count=len(surface.vertices),
        face_count=len(surface.faces),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    values = mi.traverse(mesh)
    values["vertex_positions"] = _ravel(surface.vertices)
    values["vertex_normals"] = _ravel(surface.normals)
    values["vertex_texcoords"] = _ravel(np.broadcast_to(marks, (len(surface.vertices), 2)))
    values["faces"] = np.ascontiguousarray(surface.faces, dtype=np.uint32).ravel()
    values.update()
    for attribute, array in surface.attributes.items():
        mesh.add_attribute(f"vertex_{attribute}", array.shape[1], _ravel(array))
    return mesh


def _ravel(array: NDArray[Any]) -> Any:
    return np.ascontiguousarray(array, dtype=np.float32).ravel()


def _cyclorama(stage: Stage, to_scene: NDArray[np.float64]) -> Any:
    vertices, normals, faces = stage.mesh()
    linear = to_scene[:3, :3]
    moved = (vertices.astype(np.float64) @ linear.T + to_scene[:3, 3]).astype(np.float32)
    turned = (normals.astype(np.float64) @ linear.T / np.linalg.norm(linear[:, 1])).astype(np.float32)
    material = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(stage.colour)}}
    two_sided = {"type": "twosided", "material": material}
    return _mesh("stage", Surface(moved, turned, faces), two_sided, np.array([0.0, SURROUNDINGS]))


def _softbox(softbox: Softbox, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    import mitsuba as mi

    half = mi.ScalarTransform4f().scale([softbox.width / 2.0, softbox.height / 2.0, 1.0])
    facing = mi.ScalarTransform4f().look_at(
        origin=list(softbox.position), target=list(softbox.target), up=_up_for(softbox)
    )
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(to_scene.tolist()) @ facing @ half,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(softbox.radiance)}},
    }


def _up_for(softbox: Softbox) -> list[float]:
    """The vertical, or for a lamp straight above the direction away from the camera's usual side."""
    x, _, z = np.subtract(softbox.target, softbox.position)
    return [0.0, 1.0, 0.0] if math.hypot(x, z) > 1e-3 else [0.0, 0.0, -1.0]


def _sun(sun: Sun, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    direction = to_scene[:3, :3] @ sun.direction
    return {
        "type": "directional",
        "direction": list(direction / np.linalg.norm(direction)),
        "irradiance": {"type": "rgb", "value": list(sun.irradiance)},
    }


def _sky(sky: Sky) -> dict[str, Any]:
    import mitsuba as mi

    if sky.is_uniform:
        return {"type": "constant", "radiance": {"type": "rgb", "value": list(sky.zenith)}}
    height = np.cos((np.arange(64) + 0.5) / 64 * math.pi)[:, None]
    end = np.where(height > 0.0, np.array(sky.zenith), np.array(sky.nadir))
    rows = np.array(sky.horizon) + np.abs(height) ** 0.6 * (end - np.array(sky.horizon))
    picture = np.broadcast_to(rows[:, None, :], (64, 8, 3)).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture))}


def _sensor(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    import mitsuba as mi

    return {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
        ),
        "fov": math.degrees(camera.field_of_view),
        "fov_axis": "x",
        "near_clip": camera.near,
        "far_clip": camera.far,
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "multijitter"},
    }
