"""A surface, a look, lights and a camera become a Mitsuba scene.

An engine must have been started (`render.mitsuba.engine.Engine.start`) before anything here is called.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.integrator.light_sampler import Aim, Lamps, aims
from render.mitsuba import absorption, gouraud, materials
from render.mitsuba import emitters as lamps
from render.mitsuba import stage_shapes as scenery
from render.mitsuba.mesh import mesh
from render.mitsuba.sensor import sensor
from render.mitsuba.texture_coordinates import SUBJECT, marked
from render.scene import wireframe
from render.scene.aovs import VERTEX_AOVS
from render.scene.camera import Camera
from render.scene.inside import refuse_inside
from render.scene.lights import LightRig
from render.scene.look import Look
from render.scene.quality import Crop
from render.scene.stage import Placement, Stage
from render.scene.surface import Surface

_CHANGING = (
    *("to_world", "medium.scale", absorption.RATE, "aperture_radius", "focus_distance"),
    *("sun_direction", "sun_scale", "sky_scale"),
)
"""How the names of values end that differ from frame to frame."""

BLOCK_SIZE = 16
"""Pixels along a block of the scalar variant. Each block has its own random numbers, and left alone Mitsuba
cuts the picture by the number of threads."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """A Mitsuba scene, and what Mitsuba should find out about it.

    light  a `render.integrator.path_tracer.Light` of this scene where paths are followed by our own code,
           which Mitsuba's integrator only stands for then
    """

    scene: Any
    integrator: Any
    light: Any = None

    def render(self, samples: int, seed: int) -> NDArray[np.float64]:
        """(H, W, channels) of Mitsuba's integrator: its means over `samples`, as multijitter rounds them."""
        import drjit as dr
        import mitsuba as mi

        found = mi.render(self.scene, integrator=self.integrator, spp=samples, seed=seed)
        picture = np.array(found, dtype=np.float64)
        dr.flush_malloc_cache()
        return picture

    def set(self, shape: str, attribute: str, values: NDArray[np.float32]) -> None:
        """Give the vertices of a shape other values (V, k) of an attribute that they have."""
        import mitsuba as mi

        parameters = mi.traverse(self.scene)
        parameters[f"{shape}.vertex_{attribute}"] = np.ascontiguousarray(values, dtype=np.float32).ravel()
        parameters.update()


@dataclass(frozen=True, eq=False)
class Scenes:
    """What there is to render for one picture.

    beauty  light; with the noise layer, Mitsuba's moments of it
    guides  albedo 3, depth 1, position 3, normal 3, a phase and the matte
    dyed    the albedo of the subject dyed with DYE, where layers need it
    """

    beauty: Rendering
    guides: Rendering
    dyed: Rendering | None


DYE = "dye"
"""The vertex attribute (V, 3) that dyes the subject of the scene for what vertices bring along."""


def build_scene(
    surface: Surface,
    look: Look,
    lights: LightRig,
    stage: Stage,
    placement: Placement,
    camera: Camera,
    size: tuple[int, int],
    depth: int,
    aovs: Collection[str] = (),
    crop: Crop | None = None,
) -> Scenes:
    """What to render for the beauty and for the layers. `size` is width and height in pixels,
    of which `crop` is rendered.

    Lamps are hidden from the lens in the beauty, but AOVs would show them: where a lamp stands in the
    picture they get a scene of their own without it. Raises BadInputError for a surface or a look that
    cannot be rendered, and for a camera inside of the sculpture.
    """
    surface.check()
    refuse_inside(surface, camera)
    if look.model == "gouraud":
        return _drawn(surface, look, placement, camera, size, aovs, crop)
    shown, told = marked(surface, look)
    made_of = materials.material(look, surface.attributes, told, placement.size)
    subject = mesh("subject", shown, made_of, told.values, materials.medium(look, placement.size))
    to_scene = placement.matrix()
    shapes = {"subject": subject, **scenery.shapes(stage, placement, camera, size)}
    if look.wireframe:
        shapes["wireframe"] = _wires(surface, look.wireframe, camera, size)
    common = {"type": "scene", "sensor": sensor(camera, size, crop), **shapes}
    lit = {**common, **lamps.emitters(lights, to_scene)}
    scene = _load(lit)
    bare = scene
    guides = scenery.guides(stage, placement, camera, size)
    if look.is_clear:
        guides["subject"] = mesh("subject", shown, materials.guide(look), told.values)
    if guides or lamps.any_in_view(lights, to_scene, camera, size):
        bare = _load({**common, **guides})
    beauty = _beauty(materials.path(look, depth), lights)
    found = _scenes(scene, bare, beauty, common, surface, aovs)
    return replace(found, beauty=_followed(found.beauty, beauty, aims(lights, to_scene)))


def _followed(beauty: Rendering, path: dict[str, Any], wanted: Sequence[Aim]) -> Rendering:
    """With paths of our own, where code is compiled and light is followed from surface to surface alone."""
    import mitsuba as mi

    if mi.variant() == "scalar_rgb" or path["type"] != "path":
        return beauty
    from render.integrator.path_tracer import Light

    lamps = Lamps(beauty.scene, wanted)
    light = Light(beauty.scene, beauty.integrator, lamps, path["max_depth"], path["hide_emitters"])
    return replace(beauty, light=light)


def _drawn(
    surface: Surface,
    look: Look,
    placement: Placement,
    camera: Camera,
    size: tuple[int, int],
    aovs: Collection[str],
    crop: Crop | None,
) -> Scenes:
    """A look that brings its own light and its own stage."""
    shapes = gouraud.shapes(surface, look, placement, camera, size)
    if look.wireframe:
        shapes["wireframe"] = _wires(surface, look.wireframe, camera, size)
    common = {"type": "scene", "sensor": sensor(camera, size, crop), **shapes}
    scene = _load(common)
    beauty = {"type": "aov", "aovs": "albedo:albedo", "block_size": BLOCK_SIZE}
    return _scenes(scene, scene, beauty, common, surface, aovs)


def _scenes(
    lit: Any,
    bare: Any,
    beauty: dict[str, Any],
    common: dict[str, Any],
    surface: Surface,
    aovs: Collection[str],
) -> Scenes:
    """With what the layers asked for need beside them."""
    if "noise" in aovs:
        beauty = {"type": "moment", "block_size": BLOCK_SIZE, "path": beauty}
    return Scenes(
        Rendering(lit, _integrator(beauty)),
        Rendering(bare, _integrator(_aovs())),
        _dyed(common, surface) if any(name in VERTEX_AOVS for name in aovs) else None,
    )


def _dyed(common: dict[str, Any], surface: Surface) -> Rendering:
    """The scene in which the subject's albedo is what its vertices bring along: DYE, which is set later."""
    plain = Surface(surface.vertices, surface.normals, surface.faces, {DYE: np.zeros_like(surface.vertices)})
    colour = {"type": "mesh_attribute", "name": f"vertex_{DYE}"}
    material = {"type": "twosided", "material": {"type": "diffuse", "reflectance": colour}}
    subject = mesh("subject", plain, material, np.array([0.0, SUBJECT]))
    albedo = {"type": "aov", "aovs": "albedo:albedo", "block_size": BLOCK_SIZE}
    return Rendering(_load({**common, "subject": subject}), _integrator(albedo))


def _wires(surface: Surface, drawn: wireframe.Wireframe, camera: Camera, size: tuple[int, int]) -> Any:
    lines = wireframe.ribbons(surface, drawn, camera, size[0])
    return mesh("wireframe", lines, drawn.material(), np.array([0.0, SUBJECT]))


def _integrator(description: dict[str, Any]) -> Any:
    import mitsuba as mi

    return mi.load_dict(description, parallel=False, optimize=False)


def _load(scene: dict[str, Any]) -> Any:
    """Load a scene in the order it is written.

    Its parts are loaded first, and changed as they must be: a scene whose shapes are changed later builds its
    bounding volumes again. Mitsuba's optimizer merges shapes by where their materials happen to lie in
    memory; lamps then change places from one run to the next, and with them the noise.
    """
    import mitsuba as mi

    parts = {name: _part(name, each) for name, each in scene.items() if name != "type"}
    return mi.load_dict({"type": scene["type"], **parts}, parallel=False, optimize=False)


def _part(name: str, described: Any) -> Any:
    import mitsuba as mi

    part = described
    if isinstance(described, dict):
        part = mi.load_dict(described, parallel=False, optimize=False)
        part.set_id(name)
    if mi.variant() != "scalar_rgb":
        _keep_out_of_kernels(part)
    return part


def _keep_out_of_kernels(part: Any) -> None:
    """Make where things stand, and how dense they are, data of the compiled code, not constants in it.

    Otherwise every frame whose stage moves or grows a little is compiled anew, which takes a third of a
    second and a place on the disk.
    """
    import drjit as dr
    import mitsuba as mi

    values = mi.traverse(part)
    for name in [name for name in values.keys() if name.endswith(_CHANGING)]:  # noqa: SIM118 not a dict
        dr.make_opaque(values[name])
        values[name] = values[name]
    values.update()


def _beauty(path: dict[str, Any], lights: LightRig) -> dict[str, Any]:
    return {**path, "hide_emitters": not lights.shows_sky, "block_size": BLOCK_SIZE}


def _aovs() -> dict[str, Any]:
    wanted = "albedo:albedo,depth:depth,position:position,normal:sh_normal,matte:uv"
    return {"type": "aov", "aovs": wanted, "block_size": BLOCK_SIZE}
