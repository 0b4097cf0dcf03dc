"""Attractors: their own equations, upright in a scene, and where points end up."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.plugins.attractors.attractor_flows import (
    Aizawa,
    Attractor,
    Chen,
    Chua,
    Halvorsen,
    Rossler,
    Thomas,
)

Equations = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]

ATTRACTORS: dict[str, tuple[type[Attractor | Lorenz], Equations, tuple[float, float, float]]] = {
    "lorenz": (Lorenz, lambda x, y, z: (10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z), (0, 0, 27)),
    "rossler": (Rossler, lambda x, y, z: (-y - z, x + 0.2 * y, 0.2 + z * (x - 5.7)), (0, 0, 0)),
    "aizawa": (
        Aizawa,
        lambda x, y, z: (
            (z - 0.7) * x - 3.5 * y,
            3.5 * x + (z - 0.7) * y,
            0.6 + 0.95 * z - z**3 / 3 - (x**2 + y**2) * (1 + 0.25 * z) + 0.1 * z * x**3,
        ),
        (0, 0, 0.7),
    ),
    "thomas": (
        Thomas,
        lambda x, y, z: (np.sin(y) - 0.208186 * x, np.sin(z) - 0.208186 * y, np.sin(x) - 0.208186 * z),
        (0, 0, 0),
    ),
    "chua": (Chua, lambda x, y, z: (10 * (y - x**3 + 0.143 * x), x - y + z, -16 * y), (0, 0, 0)),
    "halvorsen": (
        Halvorsen,
        lambda x, y, z: (
            -1.4 * x - 4 * y - 4 * z - y**2,
            -1.4 * y - 4 * z - 4 * x - z**2,
            -1.4 * z - 4 * x - 4 * y - x**2,
        ),
        (-3.5, -3.5, -3.5),
    ),
    "chen": (Chen, lambda x, y, z: (35 * (y - x), -7 * x - x * z + 28 * y, x * y - 3 * z), (0, 0, 21)),
}
each = pytest.mark.parametrize("name", ATTRACTORS)


def upright(points: Points) -> Points:
    """Own coordinates as the scene has them: its z is our y, its y our −z."""
    return points[:, [0, 2, 1]] * [1, 1, -1]


@each
def test_an_attractor_is_the_equations_of_its_paper_stood_upright(name: str) -> None:
    kind, equations, middle = ATTRACTORS[name]
    own = np.random.default_rng(4).normal(size=(40, 3)) * 2
    field = kind(centre=(0.5, -1.0, 2.0), scale=3.0, time_scale=0.7)
    here = upright(own - middle) / 3.0 + [0.5, -1.0, 2.0]
    expected = upright(np.stack(equations(*own.T), axis=1)) * 0.7 / 3.0
    np.testing.assert_allclose(field.velocity(here, 0.0), expected, rtol=1e-10, atol=1e-10)


@each
def test_points_near_it_stay_about_as_large_as_a_subject(name: str) -> None:
    """With the scale it has by itself, within 2 of the centre, and some of them 0.5 away or more."""
    kind = ATTRACTORS[name][0]
    start = 0.1 * np.random.default_rng(6).normal(size=(30, 3)) + [0.1, 0.0, 0.1]
    unit_time = kind()
    seconds = 40.0 / unit_time.gradient_bound(0.0)
    moved, furthest = start, 0.0
    for _ in range(15):
        moved = Streamlines(unit_time).displace(moved, 0.0, seconds)
        furthest = max(furthest, float(np.abs(moved).max()))
    assert 0.5 < furthest < 2.4


@pytest.mark.parametrize(
    ("field", "rate"),
    [
        (Lorenz(time_scale=0.5), -0.5 * (10 + 1 + 8 / 3)),
        (Thomas(time_scale=0.5), -0.5 * 3 * 0.208186),
        (Halvorsen(time_scale=0.5), -0.5 * 3 * 1.4),
        (Chen(time_scale=0.5), 0.5 * (28 - 35 - 3)),
    ],
    ids=lambda value: value.name if isinstance(value, Attractor | Lorenz) else "",
)
def test_volume_shrinks_at_a_constant_rate(field: Attractor | Lorenz, rate: float) -> None:
    points, h = np.random.default_rng(8).normal(size=(50, 3)), 1e-5
    divergence = sum(
        (field.velocity(points + a, 0.0) - field.velocity(points - a, 0.0))[:, i] / (2 * h)
        for i, a in enumerate(h * np.eye(3))
    )
    np.testing.assert_allclose(divergence, rate, rtol=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(ATTRACTORS)), st.integers(0, 10_000), st.floats(0.3, 2.0))
def test_the_gradient_stays_below_its_bound_within_reach(name: str, seed: int, factor: float) -> None:
    """With the parameters of the paper, and others; among the places are the corners of the reach."""
    kind = ATTRACTORS[name][0]
    own = [
        parameter.name for parameter in fields(kind) if len(parameter.name) <= 5 and parameter.name != "scale"
    ]
    field = kind(**{name: factor * getattr(kind(), name) for name in own}, scale=3.0, time_scale=0.7)
    reach = min(field.reach, 50.0) / field.scale
    rng, h = np.random.default_rng(seed), 1e-5
    points = np.concatenate([rng.uniform(-reach, reach, (40, 3)), reach * rng.choice([-1.0, 1.0], (8, 3))])
    gradient = np.stack(
        [
            (field.velocity(points + a, 0.0) - field.velocity(points - a, 0.0)) / (2 * h)
            for a in h * np.eye(3)
        ],
        axis=2,
    )
    assert np.linalg.norm(gradient, ord=2, axis=(1, 2)).max() <= field.gradient_bound(0.0) * (1 + 1e-6)


@each
def test_an_attractor_lies_within_its_reach(name: str) -> None:
    field, axes = ATTRACTORS[name][0](), slice(1 if name == "chua" else 3)  # which is linear in y and z
    moved = 0.1 * np.random.default_rng(6).normal(size=(60, 3)) + [0.1, 0.0, 0.1]
    for _ in range(40):
        moved = Streamlines(field).displace(moved, 0.0, 8.0 / field.gradient_bound(0.0))
        assert np.abs(moved[:, axes]).max() * field.scale <= field.reach


def test_known_fixed_points_stay() -> None:
    a, b, c = 0.2, 0.2, 5.7
    x = (c - math.sqrt(c * c - 4 * a * b)) / 2
    eye = math.sqrt(3 * 21)
    for field, own, middle in (
        (Rossler(), (x, -x / a, x / a), (0, 0, 0)),
        (Chen(), (eye, eye, 21.0), (0, 0, 21)),
        (Thomas(), (0, 0, 0), (0, 0, 0)),
        (Chua(), (math.sqrt(0.143), 0.0, -math.sqrt(0.143)), (0, 0, 0)),
        (Halvorsen(), (-9.4, -9.4, -9.4), (-3.5, -3.5, -3.5)),
    ):
        point = upright(np.array([own], dtype=float) - middle) / field.scale
        np.testing.assert_allclose(field.velocity(point, 0.0), 0.0, atol=1e-12)


def test_equal_settings_are_equal_motion_at_every_time() -> None:
    """A frame's key holds no time, so the same attractor is the same in every frame."""
    for kind in (Rossler, Aizawa, Thomas, Chua, Halvorsen, Chen):
        data = [
            [row.as_data() for row in kind(scale=scale).program(time)]
            for scale, time in ((1, 0), (1, 2), (2, 0))
        ]
        assert data[0] == data[1] != data[2]
