"""Build and render Mitsuba scenes. Needs a started engine (`render.mitsuba.engine.Engine.start`)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.mitsuba import emitters, materials
from render.mitsuba.engine import is_compiled
from render.mitsuba.loading import load_part, load_scene
from render.mitsuba.sensor import sensor
from render.mitsuba.shapes import auxiliary_stage_shapes, gouraud_shapes, mesh, stage_shapes
from render.mitsuba.texture_coordinates import SUBJECT, texture_coordinates
from render.mitsuba.tracers import path_tracer, scene_integrator
from render.scene.aovs import COPY, VERTEX_AOVS
from render.scene.materials import PatternedMaterial
from render.scene.render_quality import Quality
from render.scene.rgb_spaces import WorkingSpace, converted_pixels
from render.scene.scene import Scene, SceneSubject
from render.scene.scene_lights import LightRig
from render.scene.surface import Surface, require_camera_outside, ribbons


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
    copies    a `render.integrator.feature_tracer.CopyTracer`, or None where copies are not told apart
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
    for subject in scene.subjects:
        surface_of(subject).check()
        require_camera_outside(surface_of(subject), scene.camera)
    size = quality.width, quality.height
    if not scene.is_lit:
        return _drawn(scene, size, quality, aovs)
    return _lit(_with_converted_colours(scene).converted(), size, quality, aovs, motion_samples, seed)


def surface_of(subject: SceneSubject) -> Surface:
    """Return the triangles of a subject that is cut into triangles."""
    assert isinstance(subject.geometry, Surface), "spheres are cut into triangles first"
    return subject.geometry


def _with_converted_colours(scene: Scene) -> Scene:
    """Return the scene with the vertex colours that its materials show in the working space."""
    first, *others = (_converted(subject, scene.working_space) for subject in scene.subjects)
    return replace(
        scene,
        subject=first,
        others=tuple(
            replace(other, geometry=surface) for other, surface in zip(scene.others, others, strict=True)
        ),
    )


def _converted(subject: SceneSubject, space: WorkingSpace) -> Surface:
    surface, material = surface_of(subject), subject.material
    name = material.colour_from if isinstance(material, PatternedMaterial) else None
    if name is None or name not in surface.attributes:
        return surface
    colours = converted_pixels(surface.attributes[name], space.name)
    return replace(surface, attributes={**surface.attributes, name: colours})


def _lit(
    scene: Scene,
    size: tuple[int, int],
    quality: Quality,
    aovs: Collection[str],
    motion_samples: int,
    seed: int,
) -> FrameScenes:

    placement, camera, lights = scene.placement, scene.camera, scene.lights
    to_scene = placement.matrix()
    shapes, opaque = _subject_shapes(scene)
    shapes |= stage_shapes(scene, size)
    shapes |= _wireframes(scene, size)
    unlit = {"type": "scene", "sensor": sensor(camera, size, quality.crop), **shapes}
    lit = load_scene({**unlit, **emitters.emitters(lights, to_scene)})
    path = scene_integrator(scene, quality.depth)
    path |= {"hide_emitters": not lights.shows_sky, "block_size": BLOCK_SIZE}
    integrator = load_part(path)
    samples = quality.width * quality.height * quality.samples // motion_samples
    tracer = path_tracer(lit, integrator, path, scene, size, samples, seed)
    groups: list[tuple[Any, Any] | None] = []
    if tracer is None:
        integrator = _moment_integrator(path)
        groups = _group_renderers(unlit, path, lights, to_scene)
    beauty = SceneRenderer(lit, integrator, tracer, tuple(groups))
    if is_compiled():
        features = _feature_tracer(scene, lit, path, _vertex_aovs(scene, aovs))
        return FrameScenes(beauty, features, tracer and _copy_tracer(scene, lit, path))
    replaced = {**auxiliary_stage_shapes(scene.stage, placement, camera, size), **opaque}
    in_view = emitters.any_in_view(lights, to_scene, camera, size)
    # Softboxes are hidden from the lens in the beauty, but Mitsuba's AOVs would show them.
    auxiliary = load_scene({**unlit, **replaced}) if replaced or in_view else lit
    return FrameScenes(beauty, _mitsuba_features(auxiliary, unlit, scene, aovs))


def _subject_shapes(scene: Scene) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the shapes of the subjects by name, and matt ones for clear ones in auxiliary AOVs."""
    shapes, opaque, size = {}, {}, scene.placement.size
    for subject in scene.subjects:
        name, material = subject.shape_name, subject.material
        split, coordinates = texture_coordinates(surface_of(subject), material)
        bsdf = materials.surface_bsdf(material, surface_of(subject).attributes, coordinates, size)
        medium = materials.interior_medium(material, size)
        shapes[name] = mesh(name, split, bsdf, coordinates.values, medium)
        if material.is_clear and not is_compiled():
            matt = materials.diffuse(material.auxiliary_colour)
            opaque[name] = mesh(name, split, matt, coordinates.values)
    return shapes, opaque


def _vertex_aovs(scene: Scene, aovs: Collection[str]) -> tuple[str, ...]:
    """Return the AOVs that show attributes of the vertices of all subjects."""
    given = [surface_of(subject).attributes for subject in scene.subjects]
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


def _feature_tracer(scene: Scene, lit: Any, path: dict[str, Any], attributes: tuple[str, ...]) -> Any:
    """Return our feature tracer, which follows no path where a medium scatters light."""
    from render.integrator.feature_tracer import FeatureTracer  # needs Mitsuba's variant

    names = tuple(subject.shape_name for subject in scene.subjects)
    wires = tuple(s.wireframe_name for s in scene.subjects if s.material.wireframe)
    clear = {s.shape_name: s.material.auxiliary_colour for s in scene.subjects if s.material.is_clear}
    hides, follows = path["hide_emitters"], path["type"] == "path"
    return FeatureTracer(lit, load_part(path), hides, clear, attributes, follows, names, wires)


def _copy_tracer(scene: Scene, lit: Any, path: dict[str, Any]) -> Any:
    """Return the tracer of copies, or None where no subject has vertices that tell them apart."""
    names = {subject.shape_name for subject in scene.subjects if COPY in surface_of(subject).attributes}
    if not names:
        return None
    import drjit as dr
    import mitsuba as mi

    from render.integrator.feature_tracer import CopyTracer  # needs Mitsuba's variant

    shapes = [mi.ShapePtr(shape) for shape in lit.shapes() if shape.id() in names]
    dr.make_opaque(shapes)
    return CopyTracer(lit, load_part(path), path["hide_emitters"], shapes)


def _drawn(scene: Scene, size: tuple[int, int], quality: Quality, aovs: Collection[str]) -> FrameScenes:
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
    surface = surface_of(scene.subjects[0])
    shapes = gouraud_shapes(surface, scene.material, scene.placement, scene.camera, size, scene.working_space)
    unlit = {
        "type": "scene",
        "sensor": sensor(scene.camera, size, quality.crop),
        **shapes,
        **_wireframes(scene, size),
    }
    loaded = load_scene(unlit)
    return FrameScenes(
        SceneRenderer(loaded, load_integrator("albedo:albedo")),
        _mitsuba_features(loaded, unlit, scene, aovs),
    )


def _mitsuba_features(
    auxiliary: Any, unlit: dict[str, Any], scene: Scene, aovs: Collection[str]
) -> MitsubaFeatures:
    """Return Mitsuba's features, with a scene of the vertex attributes that `aovs` show."""
    names = [name for name in aovs if name in VERTEX_AOVS]
    surfaces = {subject.shape_name: surface_of(subject) for subject in scene.subjects}
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
            name, edges = (
                subject.wireframe_name,
                ribbons(surface_of(subject), wireframe, scene.camera, size[0]),
            )
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
    """Mitsuba's features of one scene.

    attribute_scene  the scene with the attribute VERTEX_AOV as the albedo of subjects, or None
    attributes       by the name of an AOV, values (V, 3) of each subject's points by its shape's name
    """

    scene: Any
    attribute_scene: Any
    attributes: Mapping[str, Mapping[str, NDArray[np.float32]]]

    continues_sequence: ClassVar[bool] = False

    def render(self, samples: int, first: int, seed: int) -> dict[str, Picture]:
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
    import mitsuba as mi

    description = {"type": "aov", "aovs": aovs, "block_size": BLOCK_SIZE}
    return mi.load_dict(description, parallel=False, optimize=False)


def render(scene: Any, integrator: Any, samples: int, seed: int) -> Picture:
    """Return means (H, W, channels) over `samples`, which multijitter rounds up."""
    import drjit as dr
    import mitsuba as mi

    rendered = mi.render(scene, integrator=integrator, spp=samples, seed=seed)
    picture = np.array(rendered, dtype=np.float64)
    dr.flush_malloc_cache()
    return picture
