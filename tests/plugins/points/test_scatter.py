"""Strewn points: where they belong, even, and the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.plugins.points.clouds import CloudInSolid, within
from flowsculpt.pipeline.shot.subjects import Solid

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def cloud(solid: str, fill: str, count: int = 500, seed: int = 0) -> np.ndarray:
    made = CloudInSolid(Solid.of(solid, {}), count, fill, seed, 0.1)  # type: ignore[arg-type]
    points, radii = made.points()
    assert (radii == 0.1).all()
    return points


def nearest(points: np.ndarray) -> np.ndarray:
    """The distance of each point to the next one."""
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    np.fill_diagonal(distances, np.inf)
    return distances.min(axis=1)


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(sorted(set(Solid.KINDS) - {"sheet"})), st.integers(1, 300), st.integers(0, 99))
def test_points_fill_a_solid_and_none_lies_outside(solid: str, count: int, seed: int) -> None:
    points = cloud(solid, "volume", count, seed)
    surface = Solid.of(solid, {}).project
    assert points.shape == (count, 3)
    assert surface.encloses(points).all()


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(sorted(Solid.KINDS)), st.integers(1, 300), st.integers(0, 99))
def test_points_on_a_solid_lie_on_its_true_surface(solid: str, count: int, seed: int) -> None:
    points = cloud(solid, "surface", count, seed)
    assert points.shape == (count, 3)
    assert Solid.of(solid, {}).project(points) == pytest.approx(points, abs=1e-12)


@pytest.mark.parametrize("solid", sorted(set(Solid.KINDS) - {"sheet"}))
def test_what_a_solid_encloses_agrees_with_its_normals(solid: str) -> None:
    surface = Solid.of(solid, {}).project
    points = np.random.default_rng(5).uniform(-1.6, 1.6, (400, 3))
    outwards = ((points - surface(points)) * surface.normals(points)).sum(axis=1)
    told = np.abs(outwards) > 1e-9  # at creases there is no normal
    assert told.sum() > 100
    assert (surface.encloses(points) == (outwards < 0))[told].all()


def test_a_seed_always_gives_the_same_points_and_another_gives_others() -> None:
    for fill in ("volume", "surface"):
        one, again, other = cloud("torus", fill), cloud("torus", fill), cloud("torus", fill, seed=1)
        assert np.array_equal(one, again)
        assert not np.array_equal(one, other)


def test_points_are_evener_than_chance_in_a_volume() -> None:
    even = within(BOX, lambda p: np.linalg.norm(p, axis=1) <= 1, 1500, 3)
    chance = np.random.default_rng(3).uniform(-1, 1, (6000, 3))
    chance = chance[np.linalg.norm(chance, axis=1) <= 1][:1500]
    assert np.percentile(nearest(even), 1) > 1.3 * np.percentile(nearest(chance), 1)
    assert nearest(even).max() < nearest(chance).max()
    eighths = np.bincount((even > 0) @ (1, 2, 4), minlength=8)
    assert eighths == pytest.approx(1500 / 8, rel=0.1)


def test_equal_areas_have_equally_many_points() -> None:
    points = cloud("box", "surface", 2400)
    side = np.abs(points).argmax(axis=1) * 2 + (
        np.take_along_axis(points, np.abs(points).argmax(axis=1)[:, None], axis=1)[:, 0] > 0
    )
    assert np.bincount(side) == pytest.approx(400, abs=8)


def test_faces_without_area_have_no_points() -> None:
    from flowsculpt.pipeline.mesh import TriangleMesh

    mesh = TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 0, 1], [2, 0, 0]], [[0, 1, 3], [0, 2, 1]])
    points, _ = mesh.scattered(50, 0)
    assert (points[:, 0] + points[:, 2] <= 1).all()
    assert (points[:, 2] > 0).all()
