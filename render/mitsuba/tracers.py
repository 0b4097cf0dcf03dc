"""Path tracers for Mitsuba scenes: their lights, shadow catcher, subsurface walks, guides and occluders.

Needs a started engine.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.integrator.light_sampler import LightSampler
from render.integrator.scene_emitters import EmitterGroups, sampled_emitters
from render.mitsuba import emitters, materials
from render.mitsuba.engine import is_compiled
from render.mitsuba.loading import load_scene
from render.mitsuba.sensor import sensor
from render.mitsuba.shapes import stage_shapes
from render.scene.materials import MitsubaMaterial
from render.scene.render_camera import WideCamera
from render.scene.render_quality import Quality
from render.scene.scene import Scene, SceneSubject
from render.scene.scene_lights import LightRig


def has_path_tracer(scene: Scene, quality: Quality) -> bool:
    """Tell whether our path tracer renders a scene. Needs a started engine."""
    return scene.is_lit and is_traceable(scene_integrator(scene, quality.depth))


def scene_integrator(scene: Scene, depth: int) -> dict[str, Any]:
    """Return Mitsuba's path integrator with paths long enough to pass through the materials of a scene."""
    return materials.path_integrator([subject.material for subject in scene.subjects], depth)


def is_traceable(path: dict[str, Any]) -> bool:
    """Tell whether our path tracer can replace an integrator: compiled, without scattering media."""
    return is_compiled() and path["type"] == "path"


def path_tracer(
    lit: Any,
    integrator: Any,
    path: dict[str, Any],
    scene: Scene,
    size: tuple[int, int],
    samples: int,
    seed: int = 0,
) -> Any:
    """Return our path tracer for a scene, or None where it cannot trace it.

    lit         Mitsuba's scene
    integrator  Mitsuba's, and `path` its description
    size        width and height of the picture in pixels
    samples     of all pixels together, by which photons are counted
    seed        of the photons that the lens sees

    Raises BadInputError for a shadow catcher without a path tracer.
    """
    if not is_traceable(path):
        if scene.stage.shadow_catcher:
            raise BadInputError(
                "a shadow catcher needs a compiled variant of Mitsuba and a look other than smoke. Remove "
                "shadow_catcher from the stage, or see what flowsculpt doctor says about libLLVM"
            )
        return None
    shapes = list(scene.objects.values())
    tracer = _path_tracer(lit, integrator, path, scene.lights, scene.placement.matrix(), shapes)
    walk = _subsurface_walk(lit, scene)
    if scene.stage.shadow_catcher:
        tracer = _with_catcher(tracer, scene, size, path)
    elif walk is None:
        tracer = _with_caustics(tracer, scene, size, samples, seed)
    hiding = occluders(lit, tracer.light_sampler, scene, samples)
    return replace(tracer, subsurface=walk, occluders=hiding)


def _path_tracer(
    scene: Any,
    integrator: Any,
    path: dict[str, Any],
    lights: LightRig,
    to_scene: NDArray[np.float64],
    objects: Sequence[str],
) -> Any:
    import drjit as dr
    import mitsuba as mi

    from render.integrator.path_tracer import PathTracer  # needs Mitsuba's variant
    from render.integrator.photons import CausticSun  # needs Mitsuba's variant

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


def _with_caustics(tracer: Any, scene: Scene, size: tuple[int, int], samples: int, seed: int) -> Any:
    """Return a path tracer that finds caustics: with a picture of those that the lens sees, and a guide to
    others where softboxes shine.

    The guide finds all where suns and environment maps shine, through rough glass and materials written out
    for Mitsuba, and for lenses that Mitsuba lacks.
    """
    from render.integrator.caustic_guide import guide_of  # needs Mitsuba's variant
    from render.integrator.caustic_picture import can_draw, caustic_picture
    from render.integrator.photons import photon_count, trace_photons

    lit, light_sampler, sun, depth = tracer.scene, tracer.light_sampler, tracer.caustic_sun, tracer.max_depth
    is_described = any(isinstance(subject.material, MitsubaMaterial) for subject in scene.subjects)
    if is_described or isinstance(scene.camera, WideCamera) or not can_draw(lit, light_sampler.sources):
        photons = trace_photons(lit, light_sampler, sun, depth, photon_count(samples))
        return replace(tracer, guide=photons and guide_of(photons))
    in_view = emitters.any_in_view(scene.lights, scene.placement.matrix(), scene.camera, size)
    past = tracer.integrator if tracer.hide_emitters and in_view else None
    picture, photons = caustic_picture(
        lit, light_sampler.sources, sun, tracer.groups, depth, samples, seed, past
    )
    return replace(tracer, caustics=picture, guide=guide_of(photons))


def _with_catcher(tracer: Any, scene: Scene, size: tuple[int, int], path: dict[str, Any]) -> Any:
    """Return the path tracer with the stage as its shadow catcher."""
    from render.integrator.path_tracer import ShadowCatcher

    placement, lights = scene.placement, emitters.emitters(scene.lights, scene.placement.matrix())
    floor = stage_shapes(scene, size)["stage"]
    alone = load_scene({"type": "scene", "sensor": sensor(scene.camera, size), "stage": floor, **lights})
    hidden = {**path, "hide_emitters": True}
    empty = _path_tracer(alone, tracer.integrator, hidden, scene.lights, placement.matrix(), ())
    return replace(tracer, catcher=ShadowCatcher(tracer.objects[list(scene.objects).index("stage")], empty))


def _subsurface_walk(lit: Any, scene: Scene) -> Any:
    """Return the random walks below the surfaces of the subjects, or None.

    lit  Mitsuba's scene
    """

    if not is_compiled():
        return None
    walks = [_walk_below(lit, subject, scene.placement.size) for subject in scene.subjects]
    walks = [walk for walk in walks if walk is not None]
    if len(walks) < 2:
        return walks[0] if walks else None
    from render.integrator.subsurface_paths import SubsurfaceWalks  # needs Mitsuba's variant

    return SubsurfaceWalks(walks)


def _walk_below(lit: Any, subject: SceneSubject, size: float) -> Any:
    """Return the random walks below the surface of a subject, or None. size: half of its size, scene units"""
    import drjit as dr
    import mitsuba as mi

    subsurface = getattr(subject.material, "subsurface", None)
    if subsurface is None:
        return None
    from render.integrator.subsurface_paths import SubsurfaceWalk  # needs Mitsuba's variant

    shape = next(mi.ShapePtr(shape) for shape in lit.shapes() if shape.id() == subject.shape_name)
    dr.make_opaque(shape)
    return SubsurfaceWalk(
        shape, [1.0 / (part * size) for part in subsurface.radius], subject.material.is_clear
    )


SAMPLES_PER_FACE = 30
"""Samples of a scene for each of its triangles from which on occluders pay: sorting a triangle takes as long
as leaving the cyclorama out saves in about 17 samples."""


def occluders(lit: Any, light_sampler: Any, scene: Scene, samples: int) -> Any:
    """Return a scene of the shapes that may come between emitters and the points that paths reach, or None
    where that is all of them, or too few samples are taken to build it.

    lit            Mitsuba's scene of `scene`
    light_sampler  of its emitters
    samples        of all pixels together
    """
    if scene.stage.kind in ("none", "ground") or scene.stage.shadow_catcher:
        return None
    if not len(light_sampler) or any(source.position is None for source in light_sampler.sources):
        return None
    shapes = {shape.id(): shape for shape in lit.shapes() if shape.id() != "stage"}
    faces = sum(shape.face_count() for shape in shapes.values() if shape.is_mesh())
    if samples < SAMPLES_PER_FACE * faces:
        return None
    emitting = [shape.bbox() for shape in shapes.values() if shape.is_emitter()]
    corners = [_corners(box.min, box.max) for box in emitting]
    eye_distance = getattr(scene.camera, "eye_distance", 0.0)
    camera = _corners(
        *(np.add(scene.camera.origin, s * (scene.camera.lens_radius + eye_distance)) for s in (-1, 1))
    )
    if not _is_within_backdrop(np.concatenate([*corners, camera]), scene):
        return None
    return load_scene({"type": "scene", **shapes})


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
