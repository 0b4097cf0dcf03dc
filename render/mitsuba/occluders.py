"""Occluders of softboxes: all shapes except a cyclorama around everything. Needs a started engine.

A cyclorama is convex. Where the lens and all emitters are within it, it never comes between an emitter and
what paths reach. Its large triangles lengthen the search for others: rays to emitters that leave it out save
0 to 15% of the time of the light, by the shot, and find the same.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.loading import load_scene
from render.scene.scene import Scene

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
