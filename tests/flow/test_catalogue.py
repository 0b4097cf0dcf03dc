"""Properties of each flow of the catalogue, against its textbook."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats, Points, Vectors
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.basic import (
    ABC,
    DoubleGyre,
    Rotation,
    Scaling,
    Sink,
    Source,
    Squeeze,
    Strain,
)
from flowsculpt.pipeline.flow.catalogue.vortices import SpiralVortex, Vortex, VortexPair, VortexRing

POINTS = np.random.default_rng(11).normal(size=(60, 3))


def biot_savart(points: Points, radius: float, core: float, strength: float) -> Vectors:
    """The ring about y as a sum over 720 pieces, which converges faster than any power of their number."""
    turn = 2 * np.pi * np.arange(720) / 720
    place = radius * np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    piece = (2 * np.pi * radius / 720) * np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=1)
    away = points[:, None] - place
    soft = (np.einsum("ijk,ijk->ij", away, away) + core**2) ** -1.5
    return strength / (4 * np.pi) * np.einsum("ij,ijk->ik", soft, np.cross(piece, away))


@pytest.mark.parametrize("core", [0.05, 0.3, 2.0])
def test_the_ring_is_the_law_of_biot_and_savart(core: float) -> None:
    axis = np.array([[0.0, h, 0.0] for h in (-2.0, 0.0, 0.3)])
    near = np.array([[1e-9, 0.2, 0.0], [1e-4, -0.5, 1e-4], [1.0, 0.0, 0.0], [40.0, 3.0, 1.0]])
    points = np.concatenate([POINTS, axis, near])
    found = VortexRing(radius=1.0, core=core, strength=2.0).velocity(points, 0.0)
    np.testing.assert_allclose(found, biot_savart(points, 1.0, core, 2.0), atol=1e-10)


def test_a_free_ring_would_move_as_fast_as_it_says() -> None:
    on_it = VortexRing(radius=1.5, core=0.01, strength=2.0).velocity(np.array([[1.5, 0.0, 0.0]]), 0.0)[0]
    assert on_it[1] == pytest.approx(2.0 / (4 * np.pi * 1.5) * (math.log(8 * 1.5 / 0.01) - 1), rel=1e-3)
    np.testing.assert_allclose(on_it[[0, 2]], 0.0, atol=1e-12)


def test_the_flux_out_of_a_source_is_its_strength_and_a_sink_is_its_reverse() -> None:
    sphere = POINTS / np.linalg.norm(POINTS, axis=1)[:, None]
    source, sink = Source(radius=0.2, flux=3.0), Sink(radius=0.2, flux=3.0)
    outwards = np.einsum("ij,ij->i", source.velocity(50.0 * sphere, 0.0), sphere)
    np.testing.assert_allclose(outwards * 4 * np.pi * 50.0**2, 3.0, rtol=1e-4)
    np.testing.assert_array_equal(sink.velocity(POINTS, 0.0), -source.velocity(POINTS, 0.0))


def test_a_rankine_vortex_turns_rigidly_within_and_without_vorticity_outside() -> None:
    r = np.array([0.1, 0.5, 0.7, 1.4, 7.0])
    speed = Vortex(radius=0.7, strength=3.0, profile="rankine").velocity(np.outer(r, [1.0, 0, 0]), 0.0)[:, 1]
    expected = 3.0 / (2 * np.pi) * np.minimum(r / 0.7**2, 1 / r)
    np.testing.assert_allclose(speed, expected, rtol=1e-12)


@pytest.mark.parametrize("turning", ["against", "together"])
def test_a_pair_is_its_two_vortices(turning: Any) -> None:
    pair = VortexPair(distance=2.0, radius=0.6, strength=4.0, turning=turning)
    second = 4.0 if turning == "together" else -4.0
    one, two = (
        Vortex(centre=(1, 0, 0), radius=0.6, strength=4.0),
        Vortex(centre=(-1, 0, 0), radius=0.6, strength=second),
    )
    expected = one.velocity(POINTS, 0.0) + two.velocity(POINTS, 0.0)
    np.testing.assert_allclose(pair.velocity(POINTS, 0.0), expected, atol=1e-14)


def test_a_spiral_draws_in_while_it_turns() -> None:
    spiral = SpiralVortex(axis=(0.0, 0.0, 1.0), radius=0.5, strength=3.0, inflow=0.4)
    moved = Streamlines(spiral, 200).displace(POINTS, 0.0, 1.0)
    before, after = (np.linalg.norm(p[:, :2], axis=1) for p in (POINTS, moved))
    np.testing.assert_allclose(after, before * math.exp(-0.2), rtol=1e-6)
    np.testing.assert_allclose(moved[:, 2], POINTS[:, 2] * math.exp(0.4), rtol=1e-8)


def test_scaling_is_exponential_along_each_axis() -> None:
    moved = Streamlines(Scaling((1.0, 0.0, 0.0), (0.5, 0.0, -1.0)), 50).displace(POINTS, 0.0, 1.0)
    expected = (POINTS - [1, 0, 0]) * np.exp([0.5, 0.0, -1.0]) + [1, 0, 0]
    np.testing.assert_allclose(moved, expected, rtol=1e-7, atol=1e-8)


def test_a_squeeze_is_a_strain_at_its_centre_and_nothing_far_away() -> None:
    near, far = 1e-3 * POINTS, 8.0 + np.abs(POINTS)
    squeeze, strain = Squeeze(rate=1.3), Strain(rate=1.3)
    np.testing.assert_allclose(squeeze.velocity(near, 0.0), strain.velocity(near, 0.0), atol=1e-7)
    assert np.abs(squeeze.velocity(far, 0.0)).max() < 1e-6


def curl(field: Any, points: Points, h: float = 1e-5) -> Vectors:
    d = [(field.velocity(points + a, 0.0) - field.velocity(points - a, 0.0)) / (2 * h) for a in h * np.eye(3)]
    return np.stack([d[1][:, 2] - d[2][:, 1], d[2][:, 0] - d[0][:, 2], d[0][:, 1] - d[1][:, 0]], axis=1)


def test_the_vorticity_of_abc_is_its_velocity() -> None:
    field = ABC((0.1, 0.2, 0.3), scale=2.0, a=1.0, b=-0.7, c=0.4)
    np.testing.assert_allclose(curl(field, POINTS), np.pi * field.velocity(POINTS, 0.0), atol=1e-7)


def test_the_double_gyre_is_that_of_its_paper() -> None:
    """In its own coordinates, 0 < x < 2 and 0 < y < 1, with A = 0.1, ε = 0.25 and a period of 10."""
    rng = np.random.default_rng(2)
    x, y, t = rng.uniform(0, 2, 50), rng.uniform(0, 1, 50), 3.7
    a = 0.25 * math.sin(2 * math.pi * t / 10)
    f, slope = a * x**2 + (1 - 2 * a) * x, 2 * a * x + 1 - 2 * a
    u = -math.pi * 0.1 * np.sin(math.pi * f) * np.cos(math.pi * y)
    v = math.pi * 0.1 * np.cos(math.pi * f) * np.sin(math.pi * y) * slope
    field = DoubleGyre((1.0, 0.5, 0.0), 1.0, 0.1, 0.25, 10.0)
    points = np.stack([x, y, rng.normal(size=50)], axis=1)
    np.testing.assert_allclose(field.velocity(points, t), np.stack([u, v, 0 * x], axis=1), atol=1e-14)


def eigenvalues_at(field: Any, point: Floats, h: float = 1e-6) -> Any:
    columns = [
        (field.velocity(point + a, 0.0) - field.velocity(point - a, 0.0))[0] / (2 * h) for a in h * np.eye(3)
    ]
    return np.linalg.eigvals(np.stack(columns, axis=1))


def test_turning_has_imaginary_eigenvalues() -> None:
    found = eigenvalues_at(Rotation(speed=2.0), np.array([[0.3, 0.1, 0.2]]))
    np.testing.assert_allclose(sorted(found.imag), [-2, 0, 2], atol=1e-8)
    np.testing.assert_allclose(found.real, 0, atol=1e-8)
