"""Build Mitsuba scenes. Needs a started engine (`render.mitsuba.engine.Engine.start`)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.mitsuba import emitters, materials
from render.mitsuba.features import BLOCK_SIZE, VERTEX_AOV, MitsubaFeatures, load_integrator, render
from render.mitsuba.loading import load_part, load_scene
from render.mitsuba.sensor import sensor
from render.mitsuba.shapes import auxiliary_stage_shapes, gouraud_shapes, mesh, stage_shapes
from render.mitsuba.texture_coordinates import SUBJECT, texture_coordinates
from render.mitsuba.tracers import path_tracer
from render.scene.aovs import VERTEX_AOVS
from render.scene.camera import Camera
from render.scene.lights import LightRig
from render.scene.materials import PatternedMaterial
from render.scene.quality import Quality
from render.scene.scene import Scene
from render.scene.surface import Surface, Wireframe, require_camera_outside, ribbons
from render.scene.working_space import converted_pixels


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


def build_scene(
    scene: Scene, quality: Quality, aovs: Collection[str] = (), motion_samples: int = 1
) -> FrameScenes:
    """Build the Mitsuba scenes of one frame, for the AOVs of all frames and `aovs`.

    motion_samples  scenes among which the samples of the frame are divided

    Raises BadInputError for a surface or a material that cannot be rendered, and for a camera inside the
    sculpture.
    """
    surface = scene.motion_sample.surface(quality.width)
    surface.check()
    require_camera_outside(surface, scene.camera)
    size = quality.width, quality.height
    if not scene.material.is_lit:
        return _drawn(scene, surface, size, quality, aovs)
    coloured = _with_converted_colours(surface, scene)
    return _lit(scene.converted(), coloured, size, quality, aovs, motion_samples)


def _with_converted_colours(surface: Surface, scene: Scene) -> Surface:
    """Return the surface with the vertex colours that the material shows in the working space."""
    name = scene.material.colour_from if isinstance(scene.material, PatternedMaterial) else None
    if name is None or name not in surface.attributes:
        return surface
    colours = converted_pixels(surface.attributes[name], scene.working_space.name)
    return replace(surface, attributes={**surface.attributes, name: colours})


def _lit(
    scene: Scene,
    surface: Surface,
    size: tuple[int, int],
    quality: Quality,
    aovs: Collection[str],
    motion_samples: int,
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
    lit = load_scene({**unlit, **emitters.emitters(lights, to_scene)})
    path = materials.path_integrator(material, quality.depth)
    path |= {"hide_emitters": not lights.shows_sky, "block_size": BLOCK_SIZE}
    integrator = load_part(path)
    samples = quality.width * quality.height * quality.samples // motion_samples
    tracer = path_tracer(lit, integrator, path, scene, size, samples)
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
    auxiliary = load_scene({**unlit, **replaced}) if replaced or in_view else lit
    return FrameScenes(beauty, _mitsuba_features(auxiliary, unlit, surface, aovs))


def _moment_integrator(path: dict[str, Any]) -> Any:
    return load_part({"type": "moment", "block_size": BLOCK_SIZE, "path": path})


def _group_renderers(
    unlit: dict[str, Any], path: dict[str, Any], lights: LightRig, to_scene: NDArray[np.float64]
) -> list[tuple[Any, Any] | None]:
    """Return the `groups` of a `SceneRenderer`."""
    background = emitters.background_group(lights)
    renderers: list[tuple[Any, Any] | None] = []
    for index, group in enumerate(lights.groups):
        hides = path["hide_emitters"] or (background is not None and "sky" in group.lights)
        alone = {**unlit, **emitters.emitters(lights.only(group), to_scene)}
        renderer = load_scene(alone), _moment_integrator({**path, "hide_emitters": hides})
        renderers.append(None if index == background else renderer)
    return renderers


def _feature_tracer(scene: Scene, lit: Any, path: dict[str, Any], attributes: tuple[str, ...]) -> Any:
    """Return our feature tracer, which follows no path where a medium scatters light."""
    from render.integrator.feature_tracer import FeatureTracer  # needs Mitsuba's variant

    colour = scene.material.auxiliary_colour if scene.material.is_clear else None
    hides, follows = path["hide_emitters"], path["type"] == "path"
    return FeatureTracer(lit, load_part(path), hides, colour, attributes, follows)


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
    loaded = load_scene(unlit)
    return FrameScenes(
        SceneRenderer(loaded, load_integrator("albedo:albedo")),
        _mitsuba_features(loaded, unlit, surface, aovs),
    )


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
    return MitsubaFeatures(auxiliary, load_scene({**unlit, "subject": subject}), shown)


def _wireframe(surface: Surface, wireframe: Wireframe, camera: Camera, size: tuple[int, int]) -> Any:
    lines = ribbons(surface, wireframe, camera, size[0])
    return mesh("wireframe", lines, materials.diffuse(wireframe.colour), np.array([0.0, SUBJECT]))
