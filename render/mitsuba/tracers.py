"""Our tracers for Mitsuba scenes: of paths, with their lights, guides and occluders, of features and copies.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.integrator.air_light import Air
from flowsculpt.render.integrator.caustic_guide import guide_of
from flowsculpt.render.integrator.caustic_picture import can_draw, caustic_picture
from flowsculpt.render.integrator.cut_outs import CutOuts, UnseenLights
from flowsculpt.render.integrator.feature_tracer import CopyTracer, FeatureTracer
from flowsculpt.render.integrator.light_sampler import LightSampler
from flowsculpt.render.integrator.path_tracer import PathTracer, ShadowCatcher
from flowsculpt.render.integrator.photons import CausticSun, photon_count, trace_photons
from flowsculpt.render.integrator.scene_emitters import EmitterGroups
from flowsculpt.render.integrator.subsurface_paths import SubsurfaceWalk, SubsurfaceWalks
from flowsculpt.render.mitsuba import emitters
from flowsculpt.render.mitsuba.loading import load_part, load_scene
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.mitsuba.shapes import stage_shapes
from flowsculpt.render.scene.aovs import COPY
from flowsculpt.render.scene.materials import MitsubaMaterial
from flowsculpt.render.scene.render_camera import WideCamera
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import sampled_emitters
from flowsculpt.render.scene.scene_stage import CYCLORAMAS

SAMPLES_PER_FACE = 30
"""Samples of a scene for each of its triangles from which on occluders pay: sorting a triangle takes as long
as leaving the cyclorama out saves in about 17 samples."""


def path_tracer(
    lit: Any,
    unseen: UnseenLights,
    path: dict[str, Any],
    scene: Scene,
    size: tuple[int, int],
    samples: int,
    seed: int,
    cut_outs: CutOuts | None = None,
) -> PathTracer:
    """Return the path tracer of a scene.

    lit         Mitsuba's scene
    unseen      lights that the lens does not see itself
    path        description of Mitsuba's integrator
    size        width and height of the picture in pixels
    samples     of all pixels together, by which photons are counted
    seed        of the photons that the lens sees
    cut_outs    its surfaces without their holes, or None
    """
    tracer = _path_tracer(lit, unseen, path["max_depth"], scene, list(scene.objects.values()))
    tracer = replace(tracer, cut_outs=cut_outs)
    walk = _subsurface_walk(lit, scene)
    if scene.stage.shadow_catcher:
        tracer = _with_catcher(tracer, scene, size)
    elif walk is None:
        tracer = _with_caustics(tracer, scene, size, samples, seed)
    hiding = occluders(lit, tracer.light_sampler, scene, samples, size)
    if cut_outs is not None and hiding is not None:
        hiding = replace(cut_outs, scene=hiding)
    air = scene.stage.fog and Air(scene.stage.fog, scene.placement)
    return replace(tracer, subsurface=walk, occluders=hiding, air=air)


def _path_tracer(
    lit: Any, unseen: UnseenLights, depth: int, scene: Scene, objects: Sequence[str]
) -> PathTracer:
    lights = scene.lights
    sampler = LightSampler(lit, sampled_emitters(lights, scene.placement.matrix()))
    names = list(emitters.emitters_by_group(lights).values())
    groups = EmitterGroups(lit, names, emitters.sun_disc(lights), emitters.background_group(lights))
    daylight = lights.daylight
    sun = CausticSun.of(daylight.direction, daylight.width) if daylight else None
    return PathTracer(lit, sampler, depth, unseen, groups, _pointers(lit, objects), caustic_sun=sun)


def _with_caustics(
    tracer: PathTracer, scene: Scene, size: tuple[int, int], samples: int, seed: int
) -> PathTracer:
    """Return a path tracer that finds caustics: by photons where these can bring them, else with a guide.

    The guide finds those of other suns and of environment maps, through rough glass and materials written out
    for Mitsuba, past surfaces with holes, where photons do not pass, and for lenses that Mitsuba lacks.
    """
    lit, light_sampler, sun, depth = tracer.scene, tracer.light_sampler, tracer.caustic_sun, tracer.max_depth
    is_described = any(isinstance(subject.material, MitsubaMaterial) for subject in scene.subjects)
    is_guided = is_described or tracer.cut_outs is not None or isinstance(scene.camera, WideCamera)
    if is_guided or not can_draw(lit, light_sampler.sources):
        photons = trace_photons(lit, light_sampler, sun, depth, photon_count(samples))
        return replace(tracer, guide=photons and guide_of(photons))
    unseen = tracer.unseen if emitters.unseen_softboxes(scene, size) else None
    picture = caustic_picture(lit, light_sampler.sources, sun, tracer.groups, depth, samples, seed, unseen)
    return replace(tracer, caustics=picture)


def _with_catcher(tracer: PathTracer, scene: Scene, size: tuple[int, int]) -> PathTracer:
    """Return the path tracer with the stage as its shadow catcher."""
    lights = emitters.emitters(scene.lights, scene.placement.matrix())
    floor = stage_shapes(scene, size)["stage"]
    alone = load_scene({"type": "scene", "sensor": sensor(scene.camera, size), "stage": floor, **lights})
    all_unseen = replace(tracer.unseen, sky=True, softboxes=None)
    empty = _path_tracer(alone, all_unseen, tracer.max_depth, scene, ())
    return replace(tracer, catcher=ShadowCatcher(tracer.objects[list(scene.objects).index("stage")], empty))


def _subsurface_walk(lit: Any, scene: Scene) -> SubsurfaceWalk | SubsurfaceWalks | None:
    """Return the random walks below the surfaces of the subjects. lit: Mitsuba's scene"""
    walks = []
    for subject in scene.subjects:
        if subsurface := getattr(subject.material, "subsurface", None):
            (shape,) = _pointers(lit, [subject.shape_name])
            rate = [1.0 / (part * scene.placement.size) for part in subsurface.radius]
            walks.append(SubsurfaceWalk(shape, rate, subject.material.is_clear))
    return SubsurfaceWalks(walks) if len(walks) > 1 else next(iter(walks), None)


def _pointers(scene: Any, names: Sequence[str]) -> list[Any]:
    """Return pointers to shapes of a Mitsuba scene, as data of the compiled code: their numbers differ from
    frame to frame."""
    by_name = {shape.id(): mi.ShapePtr(shape) for shape in scene.shapes()}
    pointers = [by_name[name] for name in names]
    dr.make_opaque(pointers)
    return pointers


def occluders(lit: Any, light_sampler: Any, scene: Scene, samples: int, size: tuple[int, int]) -> Any:
    """Return a scene of the shapes that may come between emitters and the points that paths reach, or None
    where that is all of them, or too few samples are taken to build it for the cyclorama's sake.

    Left out is a cyclorama around everything. It is convex: where the lens and all emitters are within it, it
    never comes between an emitter and what paths reach. Its large triangles lengthen the search for others:
    rays to emitters that leave it out save 0 to 15% of the time of the light, by the shot, and find the same.

    Softboxes that the lens does not see are left out where the picture would show their shadows.

    lit            Mitsuba's scene of `scene`
    light_sampler  of its emitters
    samples        of all pixels together
    size           width and height of the picture in pixels
    """
    left_out = set(emitters.shadowing_softboxes(scene, size))
    if _is_around_all(lit, light_sampler, scene, samples):
        left_out.add("stage")
    shapes = {shape.id(): shape for shape in lit.shapes() if shape.id() not in left_out}
    return load_scene({"type": "scene", **shapes}) if left_out else None


def _is_around_all(lit: Any, light_sampler: Any, scene: Scene, samples: int) -> bool:
    """Tell whether a cyclorama is around the lens and all emitters, and it pays to leave it out."""
    if scene.stage.kind not in CYCLORAMAS or scene.stage.shadow_catcher:
        return False
    if not len(light_sampler) or any(source.position is None for source in light_sampler.sources):
        return False
    shapes = [shape for shape in lit.shapes() if shape.id() != "stage"]
    if samples < SAMPLES_PER_FACE * sum(shape.face_count() for shape in shapes if shape.is_mesh()):
        return False
    emitting = [shape.bbox() for shape in shapes if shape.is_emitter()]
    corners = [_corners(box.min, box.max) for box in emitting]
    eye_distance = getattr(scene.camera, "eye_distance", 0.0)
    camera = _corners(
        *(np.add(scene.camera.origin, s * (scene.camera.lens_radius + eye_distance)) for s in (-1, 1))
    )
    return _is_within_backdrop(np.concatenate([*corners, camera]), scene)


def _corners(least: Any, most: Any) -> NDArray[np.float64]:
    """Return the corners (8, 3) of a box."""
    return np.array(list(itertools.product(*zip(least, most, strict=True))), dtype=np.float64)


def _is_within_backdrop(points: NDArray[np.float64], scene: Scene) -> bool:
    """Tell whether points (N, 3) are on the inner side of each triangle of the cyclorama."""
    vertices, normals, faces = scene.placement.placed(scene.stage.backdrop())
    first, second, third = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    inwards = np.cross(second - first, third - first)
    inwards *= np.sign(np.sum(inwards * normals[faces[:, 0]], axis=1))[:, None]
    return bool((inwards @ points.T >= np.sum(inwards * first, axis=1)[:, None]).all())


def surfaces_with_holes(lit: Any, fractions: Mapping[str, dict[str, Any]]) -> CutOuts | None:
    """Return the surfaces of a scene without their holes, or None where no shape has any.

    lit        Mitsuba's scene
    fractions  descriptions of textures of the fractions that are there, by the name of the shape
    """
    textures = map(load_part, fractions.values())
    pairs = list(zip(_pointers(lit, list(fractions)), textures, strict=True))
    return CutOuts(lit, pairs) if pairs else None


def unseen_lights(lit: Any, path: dict[str, Any], scene: Scene, size: tuple[int, int]) -> UnseenLights:
    """Return the lights that the lens does not see itself. path: description of Mitsuba's integrator"""
    sees_sky, hidden = scene.lights.shows_sky, emitters.unseen_softboxes(scene, size)
    are_all = not sees_sky and len(hidden) == len(emitters.softboxes_in_view(scene, size))
    return UnseenLights(load_part(path), not sees_sky, None if are_all else _pointers(lit, hidden))


def feature_tracer(
    scene: Scene, lit: Any, unseen: UnseenLights, follows: bool, attributes: tuple[str, ...], cut_outs: Any
) -> FeatureTracer:
    """Return the feature tracer of a scene.

    lit         Mitsuba's scene
    unseen      lights that the lens does not see itself
    follows     True if it follows paths: where no medium scatters light
    attributes  names of the vertex attributes that it shows
    cut_outs    as of `path_tracer`
    """
    bodies = _pointers(lit, [subject.shape_name for subject in scene.subjects])
    wires = _pointers(lit, [s.wireframe_name for s in scene.subjects if s.material.wireframe])
    materials = [subject.material for subject in scene.subjects]
    clear = [material.auxiliary_colour if material.is_clear else None for material in materials]
    return FeatureTracer(lit, unseen, bodies, wires, clear, attributes, follows, cut_outs)


def copy_tracer(scene: Scene, lit: Any, unseen: UnseenLights, cut_outs: CutOuts | None) -> CopyTracer | None:
    """Return the tracer of copies, or None where no subject has vertices that tell them apart. Arguments as
    of `feature_tracer`."""
    copied = [subject.shape_name for subject in scene.subjects if COPY in subject.surface.attributes]
    if not copied:
        return None
    return CopyTracer(lit, unseen, _pointers(lit, copied), cut_outs)
