"""Scratches follow the grain without a break, wherever the surface goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.mitsuba.texture_coordinates import scratch_corners
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES
from flowsculpt.render.scene.surface import Surface

GRAIN = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Scratches lie across y, and along x where y is the normal."""


@pytest.fixture(scope="module")
def uneven(sphere: Surface) -> Surface:
    """Return a sphere whose rest positions have the small errors of positions that were interpolated."""
    error = np.random.default_rng(4).normal(0.0, 2e-3, sphere.vertices.shape)
    return replace(sphere, rest=(sphere.vertices + error).astype(np.float32))


def test_scratches_lie_in_planes_across_the_grain(uneven: Surface) -> None:
    split, tangents, _ = scratch_corners(uneven, GRAIN)
    sides = np.abs(split.normals[:, 1]) < 0.9
    assert np.abs(tangents[sides, 1]).max() < 0.1
    assert np.abs(np.einsum("vx,vx->v", tangents, split.normals)).max() < 1e-6


def test_tangents_are_equal_on_both_sides_of_every_edge(uneven: Surface) -> None:
    _, tangents, _ = scratch_corners(uneven, GRAIN)
    corner = uneven.faces.reshape(-1)
    first = np.zeros((len(uneven.vertices), 3))
    first[corner] = tangents
    assert np.abs(np.einsum("vx,vx->v", tangents, first[corner])) == pytest.approx(1.0)


@pytest.fixture(scope="module")
def end_of_a_bar() -> Surface:
    """Return a square that faces up, with such errors of its rest positions."""
    steps = np.linspace(-1.0, 1.0, 9)
    points = np.stack(np.meshgrid(steps, [0.1], steps, indexing="ij"), axis=-1).reshape(-1, 3)
    cell = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1, 1)
    faces = np.concatenate([cell + np.array(one) for one in ((0, 1, 9), (1, 10, 9))]).astype(np.int32)
    rest = points + np.random.default_rng(2).normal(0.0, 1e-3, points.shape)
    up = np.broadcast_to(np.array([0.0, 1.0, 0.0], np.float32), points.shape)
    return Surface(points.astype(np.float32), up, faces, rest=rest.astype(np.float32))


def test_an_end_of_a_bar_is_scratched_in_one_direction(end_of_a_bar: Surface) -> None:
    _, tangents, across = scratch_corners(end_of_a_bar, GRAIN)
    assert np.abs(tangents[:, 0]).min() > 0.999
    assert np.ptp(across) == pytest.approx(2.0, abs=0.01)


def test_no_pixel_of_an_end_of_a_bar_outshines_those_around_it(
    rendered: Callable[..., RenderedFrame], end_of_a_bar: Surface
) -> None:
    layers = rendered(
        surface=end_of_a_bar,
        look=LOOKS["brushed"],
        camera=Camera((0.5, 4.0, 6.0), (0.0, 0.0, 0.0)),
        stage=STAGES["none"],
        lights=LightRig((Softbox((4.0, 3.0, -4.0), 2.0, 2.0, (9.0, 9.0, 9.0)),)),
        quality=Quality(48, 27, samples=64, depth=3, auxiliary_samples=4),
    )
    light = layers["beauty"].mean(axis=2)
    steps = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    inside = np.all([np.roll(layers["matte"] >= 0.999, step, (0, 1)) for step in steps], axis=0)
    around = np.median([np.roll(light, step, (0, 1)) for step in steps if step != (0, 0)], axis=0)
    assert inside.sum() > 100
    assert (light[inside] / around[inside]).max() < 1.3
