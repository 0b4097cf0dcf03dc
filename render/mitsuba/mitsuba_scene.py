"""Build and render Mitsuba scenes. Needs an engine that was started (`Engine.start`)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba import emitters, materials
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.mitsuba.loading import forget_other_scenes, load_part, load_scene
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.mitsuba.shapes import auxiliary_stage_shapes, gouraud_shapes, mesh, stage_shapes
from flowsculpt.render.mitsuba.texture_coordinates import SUBJECT, texture_coordinates
from flowsculpt.render.scene.aovs import VERTEX_AOVS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.surface import Surface, require_camera_outside, ribbons


@dataclass(frozen=True, eq=False)
class SceneRenderer:
    """A Mitsuba scene and an integrator.

    path_tracer  a `PathTracer` of the scene that replaces the integrator, or None
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
    features  the tracer of auxiliary features: `flowsculpt.render.integrator.feature_tracer.FeatureTracer` or
              `MitsubaFeatures`
    copies    a `CopyTracer`, or None where copies are not told apart
    """

    beauty: SceneRenderer
    features: Any
    copies: Any = None


def build_scene(
    scene: Scene, quality: Quality, aovs: Collection[str] = (), motion_samples: int = 1, seed: int = 0
) -> FrameScenes:
    """Build the Mitsuba scenes of one frame, for the AOVs of all frames and `aovs`.

    motion_samples  scenes among which the samples of the frame are divided
    seed            of photons, a different one for each of these scenes

    Raises BadInputError for a surface or a material that cannot be rendered, and for a camera inside the
    sculpture.
    """
    scene = scene.at(scene.motion_sample.with_surfaces(quality.width))
    has_opacity = any(subject.material.has_opacity for subject in scene.subjects)
    fades = scene.is_lit and scene.stage.horizon_fade > 0.0
    if scene.is_lit and scene.stage.fog and not has_path_tracer(scene, quality):
        raise BadInputError(
            "the air of the stage fog needs a compiled variant of Mitsuba and a shot without smoke. Take "
            "another stage, remove the smoke, or see what flowsculpt doctor says about libLLVM"
        )
    if (has_opacity or fades) and not has_path_tracer(scene, quality):
        what, remedy = ("the opacity of a model", "Write paint: off")
        if fades:
            what, remedy = ("the fade of the horizon", "Leave horizon_fade out")
        raise BadInputError(
            f"{what} needs a compiled variant of Mitsuba and a shot without smoke. {remedy}, remove the "
            "smoke, or see what flowsculpt doctor says about libLLVM"
        )
    worn = any(getattr(subject.material, "wear", ()) for subject in scene.subjects)
    if (worn or scene.stage.finish or scene.stage.plinth_finish) and not is_compiled():
        what = "the wear of a look" if worn else "the finish of a stage"
        raise BadInputError(
            f"{what} needs a compiled variant of Mitsuba. Leave it out, or see what flowsculpt doctor says "
            "about libLLVM"
        )
    for subject in scene.subjects:
        subject.surface.check()
        require_camera_outside(subject.surface, scene.camera)
    forget_other_scenes((scene.stage, *(subject.material for subject in scene.subjects)))
    if not scene.is_lit:
        return _draw(scene, quality, aovs)
    return _lit(scene.converted(), quality, aovs, motion_samples, seed)


def has_path_tracer(scene: Scene, quality: Quality) -> bool:
    """Tell whether our path tracer renders a scene: one with lights and no media, on a compiled variant."""
    return scene.is_lit and is_compiled() and _integrator(scene, quality)["type"] == "path"


def _integrator(scene: Scene, quality: Quality) -> dict[str, Any]:
    return materials.path_integrator([subject.material for subject in scene.subjects], quality.depth)


def _path_integrator(scene: Scene, quality: Quality) -> dict[str, Any]:
    """Return Mitsuba's path integrator with paths long enough to pass through the materials of a scene."""
    in_view = emitters.softboxes_in_view(scene, quality.size)
    sees_light = scene.lights.shows_sky or in_view != emitters.unseen_softboxes(scene, quality.size)
    return {**_integrator(scene, quality), "hide_emitters": not sees_light, "block_size": BLOCK_SIZE}


def _lit(
    scene: Scene, quality: Quality, aovs: Collection[str], motion_samples: int, seed: int
) -> FrameScenes:
    size, lights, to_scene = quality.size, scene.lights, scene.placement.matrix()
    shapes, opaque, fractions = _subject_shapes(scene)
    shapes |= stage_shapes(scene, size) | _wireframes(scene, size)
    if scene.stage.horizon_fade:
        fractions["stage"] = {"type": "mesh_attribute", "name": "vertex_there"}
    unlit = {"type": "scene", "sensor": sensor(scene.camera, size, quality.crop), **shapes}
    lit = load_scene({**unlit, **emitters.emitters(lights, to_scene)})
    path, cut_outs = _path_integrator(scene, quality), None
    if has_path_tracer(scene, quality):
        from flowsculpt.render.mitsuba import tracers  # needs the variant

        cut_outs, unseen = (
            tracers.surfaces_with_holes(lit, fractions),
            tracers.unseen_lights(lit, path, scene, size),
        )
        copies = tracers.copy_tracer(scene, lit, unseen, cut_outs)
        samples = quality.width * quality.height * quality.samples // motion_samples
        tracer = tracers.path_tracer(lit, unseen, path, scene, size, samples, seed, cut_outs)
        beauty = SceneRenderer(lit, unseen.integrator, tracer)
    elif scene.stage.shadow_catcher:
        raise BadInputError(
            "a shadow catcher needs a compiled variant of Mitsuba and a look other than smoke. Remove "
            "shadow_catcher from the stage, or see what flowsculpt doctor says about libLLVM"
        )
    else:
        _require_one_sight(scene, size)
        groups, copies = _group_renderers(unlit, path, lights, to_scene), None
        beauty = SceneRenderer(lit, _moment_integrator(path), groups=tuple(groups))
    if is_compiled():
        from flowsculpt.render.mitsuba import tracers

        unseen, follows = tracers.unseen_lights(lit, path, scene, size), path["type"] == "path"
        attributes = _vertex_aovs(scene, aovs)
        features = tracers.feature_tracer(scene, lit, unseen, follows, attributes, cut_outs)
        return FrameScenes(beauty, features, copies)
    replaced = auxiliary_stage_shapes(scene, size) | opaque
    in_view = emitters.softboxes_in_view(scene, size)
    # Softboxes are hidden from the lens in the beauty, but Mitsuba's AOVs would show them.
    auxiliary = load_scene({**unlit, **replaced}) if replaced or in_view else lit
    return FrameScenes(beauty, _mitsuba_features(auxiliary, unlit, scene, aovs))


def _require_one_sight(scene: Scene, size: tuple[int, int]) -> None:
    """Raise BadInputError where the lens sees some lights and not others: Mitsuba's integrators cannot."""
    in_view, hidden = emitters.softboxes_in_view(scene, size), emitters.unseen_softboxes(scene, size)
    sees_some = scene.lights.shows_sky or len(hidden) < len(in_view)
    if sees_some and (hidden or not scene.lights.shows_sky):
        raise BadInputError(
            "the lens sees some lights in the picture and not others, which needs a compiled variant of "
            "Mitsuba and a look other than smoke. Write visible: true for the sky and every softbox in the "
            "picture, or for none"
        )


def _subject_shapes(scene: Scene) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return the shapes of the subjects by name, matt ones for clear ones in auxiliary AOVs, and the textures
    of the fractions of surfaces that are there, of those with holes."""
    shapes, opaque, fractions, size = {}, {}, {}, scene.placement.size
    for subject in scene.subjects:
        name, material = subject.shape_name, subject.material
        split, coordinates = texture_coordinates(subject.surface, material)
        if getattr(material, "wear", ()):
            from flowsculpt.render.mitsuba.detail_textures import with_detail_places  # needs the variant

            split = with_detail_places(split)
        bsdf = materials.surface_bsdf(material, split.attributes, coordinates, size)
        medium = materials.interior_medium(material, size)
        if material.has_opacity:
            fractions[name] = materials.opacity_texture(material, split.attributes, coordinates)
        shapes[name] = mesh(name, split, bsdf, coordinates.values, medium)
        if material.is_clear and not is_compiled():
            matt = materials.diffuse(material.auxiliary_colour)
            opaque[name] = mesh(name, split, matt, coordinates.values)
    return shapes, opaque, fractions


def _vertex_aovs(scene: Scene, aovs: Collection[str]) -> tuple[str, ...]:
    """Return the AOVs that show attributes of the vertices of all subjects."""
    given = [subject.surface.attributes for subject in scene.subjects]
    return tuple(name for name in aovs if name in VERTEX_AOVS and all(name in each for each in given))


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


def _draw(scene: Scene, quality: Quality, aovs: Collection[str]) -> FrameScenes:
    """Build the scenes of a material that brings its own light and background."""
    if scene.others:
        raise BadInputError(
            "a look that is drawn without lights shows one subject, and the scene has "
            "several. Use other looks"
        )
    if scene.lights.groups:
        raise BadInputError(
            "the look is drawn without lights, so it has no light groups. Remove light_groups, or use "
            "another look"
        )
    shapes = gouraud_shapes(scene, quality.size) | _wireframes(scene, quality.size)
    unlit = {"type": "scene", "sensor": sensor(scene.camera, quality.size, quality.crop), **shapes}
    loaded = load_scene(unlit)
    renderer = SceneRenderer(loaded, load_integrator("albedo:albedo"))
    return FrameScenes(renderer, _mitsuba_features(loaded, unlit, scene, aovs))


def _mitsuba_features(
    auxiliary: Any, unlit: dict[str, Any], scene: Scene, aovs: Collection[str]
) -> MitsubaFeatures:
    """Return Mitsuba's features, with a scene of the vertex attributes that `aovs` show."""
    names = [name for name in aovs if name in VERTEX_AOVS]
    surfaces = {subject.shape_name: subject.surface for subject in scene.subjects}
    shown = {name: {shape: surface.attributes[name] for shape, surface in surfaces.items()} for name in names}
    if not shown:
        return MitsubaFeatures(auxiliary, None, shown)
    plain = {shape: _plain(shape, surface) for shape, surface in surfaces.items()}
    return MitsubaFeatures(auxiliary, load_scene({**unlit, **plain}), shown)


def _plain(name: str, surface: Surface) -> Any:
    """Return a subject whose colour is the vertex attribute VERTEX_AOV."""
    attributes = {VERTEX_AOV: np.zeros_like(surface.vertices)}
    plain = Surface(surface.vertices, surface.normals, surface.faces, attributes)
    return mesh(name, plain, materials.vertex_attribute(VERTEX_AOV), np.array([0.0, SUBJECT]))


def _wireframes(scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    """Return the lines along the edges of subjects that show them, by their names."""
    lines = {}
    for subject in scene.subjects:
        if wireframe := subject.material.wireframe:
            name = subject.wireframe_name
            edges = ribbons(subject.surface, wireframe, scene.camera, size[0])
            lines[name] = mesh(name, edges, materials.diffuse(wireframe.colour), np.array([0.0, SUBJECT]))
    return lines


Picture = NDArray[np.float64]

BLOCK_SIZE = 16
"""Pixels along a block of the scalar variant. Each block has its own random numbers; by default Mitsuba cuts
the picture by the number of threads."""

VERTEX_AOV = "dye"
"""Name of the vertex attribute (V, 3) that a scene of attributes shows."""

_WANTED = "albedo:albedo,depth:depth,position:position,normal:sh_normal,matte:uv"
_CHANNELS = {
    "albedo": slice(0, 3),
    "depth": slice(3, 4),
    "position": slice(4, 7),
    "normal": slice(7, 10),
    "matte": slice(11, 12),
}
"""Channels of each feature. The matte is the second texture coordinate."""


@dataclass(frozen=True, eq=False)
class MitsubaFeatures:
    """Auxiliary features of one scene by Mitsuba's `aov` integrator, where our feature tracer cannot trace.

    The scalar variant compiles no code, and drawn materials bring a picture instead of light.

    attribute_scene  the scene with the attribute VERTEX_AOV as the albedo of subjects, or None
    attributes       by the name of an AOV, values (V, 3) of each subject's points by its shape's name
    """

    scene: Any
    attribute_scene: Any
    attributes: Mapping[str, Mapping[str, NDArray[np.float32]]]

    continues_sequence: ClassVar[bool] = False

    def render(self, samples: int, first: int, seed: int, pixels: None = None) -> dict[str, Picture]:
        """Return albedo, normal, position, depth, matte and attributes (H, W, channels) as means.

        samples  multijitter rounds them up
        first    samples that were taken before; they have no influence
        """
        picture = render(self.scene, load_integrator(_WANTED), samples, seed)
        features = {name: picture[..., channels] for name, channels in _CHANNELS.items()}
        return features | (self._attributes(samples, seed) if self.attributes else {})

    def _attributes(self, samples: int, seed: int) -> dict[str, Picture]:
        """Return means (H, W, 3) of attributes over the pixels, 0 where the subject is not.

        Mitsuba has an AOV for albedo, but none for attributes. A scene with the attribute as its subject's
        colour is rendered with the samples of the other features, so that coverage is the same. Minus the
        scene with the attribute 0, it shows the attribute alone.
        """
        integrator = load_integrator("albedo:albedo")

        def shown(values: Mapping[str, NDArray[np.float32]]) -> Picture:
            self._show(values)
            return render(self.attribute_scene, integrator, samples, seed)[..., :3]

        some = next(iter(self.attributes.values()))
        others = shown({shape: np.zeros_like(values) for shape, values in some.items()})
        return {name: shown(values) - others for name, values in self.attributes.items()}

    def _show(self, values: Mapping[str, NDArray[np.float32]]) -> None:
        import mitsuba as mi

        parameters = mi.traverse(self.attribute_scene)
        for shape, array in values.items():
            parameters[f"{shape}.vertex_{VERTEX_AOV}"] = np.ascontiguousarray(array, dtype=np.float32).ravel()
        parameters.update()


def load_integrator(aovs: str) -> Any:
    """Return Mitsuba's integrator of AOVs."""
    return load_part({"type": "aov", "aovs": aovs, "block_size": BLOCK_SIZE})


def render(scene: Any, integrator: Any, samples: int, seed: int) -> Picture:
    """Return means (H, W, channels) over `samples`, which multijitter rounds up."""
    import drjit as dr
    import mitsuba as mi

    rendered = mi.render(scene, integrator=integrator, spp=samples, seed=seed)
    picture = np.array(rendered, dtype=np.float64)
    dr.flush_malloc_cache()
    return picture
