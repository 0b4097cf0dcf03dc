"""Build Mitsuba scenes. Needs a started engine (`render.mitsuba.engine.Engine.start`)."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.integrator.emitter_groups import EmitterGroups
from render.integrator.light_sampler import LightSampler, sampled_emitters
from render.mitsuba import absorption, emitters, materials
from render.mitsuba.features import BLOCK_SIZE, VERTEX_AOV, MitsubaFeatures, load_integrator, render
from render.mitsuba.shapes import auxiliary_stage_shapes, gouraud_shapes, mesh, stage_shapes
from render.mitsuba.texture_coordinates import SUBJECT, texture_coordinates
from render.scene.aovs import VERTEX_AOVS
from render.scene.camera import Camera
from render.scene.lights import LightRig
from render.scene.materials import Material, PatternedMaterial
from render.scene.quality import Crop, Quality
from render.scene.scene import Scene
from render.scene.surface import Surface, Wireframe, require_camera_outside, ribbons
from render.scene.working_space import converted_pixels

_CHANGING = (
    *("to_world", "medium.scale", absorption.RATE, "aperture_radius", "focus_distance"),
    *("sun_direction", "sun_scale", "sky_scale"),
)
"""Ends of the names of parameters that differ from frame to frame."""


@dataclass(frozen=True, eq=False)
class SceneRenderer:
    """A Mitsuba scene and an integrator.

    path_tracer  a `render.integrator.path_tracer.PathTracer` of the scene that replaces the integrator, or
                 None
    groups       without a path tracer, the scenes in which one light group alone shines, each with an
                 integrator; None for the group of what the lens sees of the sky, which is what others leave
    """

    scene: Any
    integrator: Any
    path_tracer: Any = None
    groups: tuple[tuple[Any, Any] | None, ...] = ()

    def render(self, samples: int, seed: int) -> NDArray[np.float64]:
        """Return means (H, W, channels) over `samples`, which multijitter rounds up, by the integrator."""
        return render(self.scene, self.integrator, samples, seed)

    def render_groups(
        self, samples: int, seed: int, radiance: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the radiance (H, W, 3) of each light group.

        radiance  (H, W, 3) of all light by `render` with these samples and seed. The same seed gives the same
                  paths, so that groups sum to it
        """
        lit = [each and render(*each, samples, seed)[..., :3] for each in self.groups]
        rest = radiance - sum(each for each in lit if each is not None)
        return [rest if each is None else each for each in lit]


@dataclass(frozen=True, eq=False)
class FrameScenes:
    """The renderers of one frame.

    beauty    light; Mitsuba's integrators, which follow it where there is no path tracer, add its moments
    features  the tracer of auxiliary features: `render.integrator.feature_tracer.FeatureTracer` or
              `MitsubaFeatures`
    """

    beauty: SceneRenderer
    features: Any


def build_scene(scene: Scene, quality: Quality, aovs: Collection[str] = ()) -> FrameScenes:
    """Build the Mitsuba scenes of one frame, for the AOVs of all frames and `aovs`.

    Raises BadInputError for a surface or a material that cannot be
    rendered, and for a camera inside the sculpture.
    """
    surface = scene.motion_sample.surface(quality.width)
    surface.check()
    require_camera_outside(surface, scene.camera)
    size = quality.width, quality.height
    if not scene.material.is_lit:
        return _drawn(scene, surface, size, quality, aovs)
    return _lit(scene.converted(), _with_converted_colours(surface, scene), size, quality, aovs)


def _with_converted_colours(surface: Surface, scene: Scene) -> Surface:
    """Return the surface with the vertex colours that the material shows in the working space."""
    name = scene.material.colour_from if isinstance(scene.material, PatternedMaterial) else None
    if name is None or name not in surface.attributes:
        return surface
    colours = converted_pixels(surface.attributes[name], scene.working_space.name)
    return replace(surface, attributes={**surface.attributes, name: colours})


def _lit(
    scene: Scene, surface: Surface, size: tuple[int, int], quality: Quality, aovs: Collection[str]
) -> FrameScenes:
    import mitsuba as mi

    material, placement, camera, lights = scene.material, scene.placement, scene.camera, scene.lights
    split, coordinates = texture_coordinates(surface, material)
    bsdf = materials.surface_bsdf(material, surface.attributes, coordinates, placement.size)
    medium = materials.interior_medium(material, placement.size)
    subject = mesh("subject", split, bsdf, coordinates.values, medium)
    to_scene = placement.matrix()
    shapes = {"subject": subject, **stage_shapes(scene.stage, placement, camera, size, scene.working_space)}
    if material.wireframe:
        shapes["wireframe"] = _wireframe(surface, material.wireframe, camera, size)
    unlit = {"type": "scene", "sensor": sensor(camera, size, quality.crop), **shapes}
    lit = _load({**unlit, **emitters.emitters(lights, to_scene)})
    path = materials.path_integrator(material, quality.depth)
    path |= {"hide_emitters": not lights.shows_sky, "block_size": BLOCK_SIZE}
    integrator = _load_part(path)
    tracer = _path_tracer(lit, integrator, path, lights, to_scene, scene.objects)
    if scene.stage.shadow_catcher:
        tracer = _with_catcher(tracer, scene, size, path)
    walk = _subsurface_walk(lit, material, placement.size)
    if tracer is not None and walk is not None:
        tracer = replace(tracer, subsurface=walk)
    groups: list[tuple[Any, Any] | None] = []
    if tracer is None:
        integrator = _moment_integrator(path)
        groups = _group_renderers(unlit, path, lights, to_scene)
    beauty = SceneRenderer(lit, integrator, tracer, tuple(groups))
    if mi.variant() != "scalar_rgb":
        attributes = tuple(name for name in aovs if name in VERTEX_AOVS and name in surface.attributes)
        return FrameScenes(beauty, _feature_tracer(scene, lit, path, attributes))
    replaced = auxiliary_stage_shapes(scene.stage, placement, camera, size)
    if material.is_clear:
        opaque = materials.diffuse(material.auxiliary_colour)
        replaced["subject"] = mesh("subject", split, opaque, coordinates.values)
    in_view = emitters.any_in_view(lights, to_scene, camera, size)
    # Softboxes are hidden from the lens in the beauty, but Mitsuba's AOVs would show them.
    auxiliary = _load({**unlit, **replaced}) if replaced or in_view else lit
    return FrameScenes(beauty, _mitsuba_features(auxiliary, unlit, surface, aovs))


def _moment_integrator(path: dict[str, Any]) -> Any:
    return _load_part({"type": "moment", "block_size": BLOCK_SIZE, "path": path})


def _group_renderers(
    unlit: dict[str, Any], path: dict[str, Any], lights: LightRig, to_scene: NDArray[np.float64]
) -> list[tuple[Any, Any] | None]:
    """Return the `groups` of a `SceneRenderer`."""
    background = emitters.background_group(lights)
    renderers: list[tuple[Any, Any] | None] = []
    for index, group in enumerate(lights.groups):
        hides = path["hide_emitters"] or (background is not None and "sky" in group.lights)
        alone = {**unlit, **emitters.emitters(lights.only(group), to_scene)}
        renderer = _load(alone), _moment_integrator({**path, "hide_emitters": hides})
        renderers.append(None if index == background else renderer)
    return renderers


def _feature_tracer(scene: Scene, lit: Any, path: dict[str, Any], attributes: tuple[str, ...]) -> Any:
    """Return our feature tracer, which follows no path where a medium scatters light."""
    from render.integrator.feature_tracer import FeatureTracer  # needs Mitsuba's variant

    colour = scene.material.auxiliary_colour if scene.material.is_clear else None
    hides, follows = path["hide_emitters"], path["type"] == "path"
    return FeatureTracer(lit, _load_part(path), hides, colour, attributes, follows)


def _drawn(
    scene: Scene, surface: Surface, size: tuple[int, int], quality: Quality, aovs: Collection[str]
) -> FrameScenes:
    """Build the scenes of a material that brings its own light and background."""
    if scene.lights.groups:
        raise BadInputError(
            "the look is drawn without lights, so it has no light groups. Remove light_groups, or take "
            "another look"
        )
    shapes = gouraud_shapes(surface, scene.material, scene.placement, scene.camera, size, scene.working_space)
    if scene.material.wireframe:
        shapes["wireframe"] = _wireframe(surface, scene.material.wireframe, scene.camera, size)
    unlit = {"type": "scene", "sensor": sensor(scene.camera, size, quality.crop), **shapes}
    loaded = _load(unlit)
    return FrameScenes(
        SceneRenderer(loaded, load_integrator("albedo:albedo")),
        _mitsuba_features(loaded, unlit, surface, aovs),
    )


def has_path_tracer(material: Material, quality: Quality) -> bool:
    """Tell whether our path tracer renders a material. Needs a started engine."""
    return material.is_lit and _is_traceable(materials.path_integrator(material, quality.depth))


def _is_traceable(path: dict[str, Any]) -> bool:
    """Tell whether our path tracer can replace an integrator: compiled, without scattering media."""
    import mitsuba as mi

    return mi.variant() != "scalar_rgb" and path["type"] == "path"


def _path_tracer(
    scene: Any,
    integrator: Any,
    path: dict[str, Any],
    lights: LightRig,
    to_scene: NDArray[np.float64],
    objects: Sequence[str],
) -> Any:
    """Return our path tracer, or None where it cannot trace the scene."""
    if not _is_traceable(path):
        return None
    import drjit as dr
    import mitsuba as mi

    from render.integrator.caustic_sun import CausticSun  # needs Mitsuba's variant
    from render.integrator.path_tracer import PathTracer  # needs Mitsuba's variant

    sampler = LightSampler(scene, sampled_emitters(lights, to_scene))
    names = list(emitters.emitters_by_group(lights).values())
    groups = EmitterGroups(scene, names, emitters.sun_disc(lights), emitters.background_group(lights))
    by_name = {shape.id(): mi.ShapePtr(shape) for shape in scene.shapes()}
    shapes = [by_name[name] for name in objects]
    dr.make_opaque(shapes)  # numbers of shapes differ from frame to frame; the compiled code shall not
    daylight = lights.daylight
    sun = CausticSun.of(daylight.direction, daylight.width) if daylight else None
    depth, hide = path["max_depth"], path["hide_emitters"]
    return PathTracer(scene, integrator, sampler, depth, hide, groups, shapes, caustic_sun=sun)


def _with_catcher(tracer: Any, scene: Scene, size: tuple[int, int], path: dict[str, Any]) -> Any:
    """Return the path tracer with the stage as its shadow catcher. Raises BadInputError for None."""
    if tracer is None:
        raise BadInputError(
            "a shadow catcher needs a compiled variant of Mitsuba and a look other than smoke. Remove "
            "shadow_catcher from the stage, or read what flowsculpt doctor says of libLLVM"
        )
    from render.integrator.path_tracer import ShadowCatcher

    placement, lights = scene.placement, emitters.emitters(scene.lights, scene.placement.matrix())
    floor = stage_shapes(scene.stage, placement, scene.camera, size, scene.working_space)["stage"]
    alone = _load({"type": "scene", "sensor": sensor(scene.camera, size), "stage": floor, **lights})
    hidden = {**path, "hide_emitters": True}
    empty = _path_tracer(alone, tracer.integrator, hidden, scene.lights, placement.matrix(), ())
    return replace(tracer, catcher=ShadowCatcher(tracer.objects[scene.objects.index("stage")], empty))


def _subsurface_walk(scene: Any, material: Material, size: float) -> Any:
    """Return the random walks below the subject's surface, or None. size: half the subject's, scene units"""
    import mitsuba as mi

    subsurface = getattr(material, "subsurface", None)
    if subsurface is None or mi.variant() == "scalar_rgb":
        return None
    import drjit as dr

    from render.integrator.subsurface import SubsurfaceWalk  # needs Mitsuba's variant

    shape = next(mi.ShapePtr(shape) for shape in scene.shapes() if shape.id() == "subject")
    dr.make_opaque(shape)
    return SubsurfaceWalk(shape, [1.0 / (part * size) for part in subsurface.radius], material.is_clear)


def _mitsuba_features(
    auxiliary: Any, unlit: dict[str, Any], surface: Surface, aovs: Collection[str]
) -> MitsubaFeatures:
    """Return Mitsuba's features, with a scene of the vertex attributes that `aovs` show."""
    shown = {name: surface.attributes[name] for name in aovs if name in VERTEX_AOVS}
    if not shown:
        return MitsubaFeatures(auxiliary, None, shown)
    attributes = {VERTEX_AOV: np.zeros_like(surface.vertices)}
    plain = Surface(surface.vertices, surface.normals, surface.faces, attributes)
    subject = mesh("subject", plain, materials.vertex_attribute(VERTEX_AOV), np.array([0.0, SUBJECT]))
    return MitsubaFeatures(auxiliary, _load({**unlit, "subject": subject}), shown)


def _wireframe(surface: Surface, wireframe: Wireframe, camera: Camera, size: tuple[int, int]) -> Any:
    lines = ribbons(surface, wireframe, camera, size[0])
    return mesh("wireframe", lines, materials.diffuse(wireframe.colour), np.array([0.0, SUBJECT]))


def _load(scene: dict[str, Any]) -> Any:
    """Load a scene with its parts in order.

    Parts are loaded and changed first: a scene whose shapes change later builds its bounding volumes again.
    Mitsuba's optimizer is off: it merges shapes by the memory addresses of their materials, so emitters would
    change places from one run to the next, and with them the noise.
    """
    import mitsuba as mi

    parts = {name: _named_part(name, part) for name, part in scene.items() if name != "type"}
    return mi.load_dict({"type": scene["type"], **parts}, parallel=False, optimize=False)


def _load_part(description: dict[str, Any]) -> Any:
    import mitsuba as mi

    return mi.load_dict(description, parallel=False, optimize=False)


def _named_part(name: str, described: Any) -> Any:
    import mitsuba as mi

    part = described
    if isinstance(described, dict):
        part = _load_part(described)
        part.set_id(name)
    if mi.variant() != "scalar_rgb":
        _make_opaque(part)
    return part


def _make_opaque(part: Any) -> None:
    """Make transforms and densities data of the compiled code, not constants in it.

    With constants, every frame whose stage moves or grows a little is compiled again, which takes a third of
    a second and space on the disk.
    """
    import drjit as dr
    import mitsuba as mi

    values = mi.traverse(part)
    for name in [name for name in values.keys() if name.endswith(_CHANGING)]:  # noqa: SIM118 not a dict
        dr.make_opaque(values[name])
        values[name] = values[name]
    values.update()


def sensor(camera: Camera, size: tuple[int, int], crop: Crop | None = None) -> dict[str, Any]:
    """Return the sensor: lens, film and Mitsuba's sampler.

    size  width and height of the picture in pixels
    crop  rendered part of it, or None for all

    Raises BadInputError where the focus is not in front of the lens.
    """
    import mitsuba as mi

    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    if crop is not None:
        x0, y0, x1, y1 = crop
        film |= {"crop_offset_x": x0, "crop_offset_y": y0, "crop_width": x1 - x0, "crop_height": y1 - y0}
    return {
        **_lens(camera),
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
        ),
        "fov": math.degrees(camera.field_of_view),
        "fov_axis": "x",
        "near_clip": camera.near,
        "far_clip": camera.far,
        "film": film,
        "sampler": {"type": "multijitter"},
    }


def _lens(camera: Camera) -> dict[str, Any]:
    """Return a pinhole, or a thin lens with one plane in focus."""
    if not camera.has_depth_of_field:
        return {"type": "perspective"}
    if camera.focus_distance <= camera.near:
        where = f"{-camera.focus_distance:.4g} units behind" if camera.focus_distance < 0.0 else "within"
        raise BadInputError(
            f"the camera's focus lies {where} the lens; it must lie before it. Move it, or leave focus out"
        )
    return {
        "type": "thinlens",
        "aperture_radius": camera.lens_radius,
        "focus_distance": camera.focus_distance,
    }
