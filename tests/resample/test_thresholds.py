"""Thresholds as functions over the surface (P35): what they are, and what resampling makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, sheet, torus, validate
from flowsculpt.pipeline.resample import (
    Curvature,
    DistanceToCamera,
    Exact,
    Resampler,
    ThresholdFormula,
    Thresholds,
    resample,
)
from flowsculpt.pipeline.resample.kernels.edge_scans import edge_curvature, limit_gradation
from flowsculpt.pipeline.resample.thresholds import curvature, graded

BALL = icosphere(12)


def edges(mesh: TriangleMesh) -> np.ndarray:
    ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    return np.unique(np.sort(ends, axis=1), axis=0)


def lengths(mesh: TriangleMesh) -> np.ndarray:
    a, b = mesh.vertices[edges(mesh)].transpose(1, 0, 2)
    return np.linalg.norm(a - b, axis=1)


def ellipsoid(*radii: float) -> TriangleMesh:
    """Squashed from a ball, with its exact normals."""
    points = BALL.vertices * radii
    normals = BALL.vertices / radii
    return TriangleMesh(
        points, BALL.faces, {"normal": normals / np.linalg.norm(normals, axis=1, keepdims=True)}
    )


@dataclass(frozen=True)
class Stepped:
    """0.4 everywhere, 0.05 near the north pole, and finer with every frame."""

    shrink: float = 1.0

    def at(self, frame: int, time: float) -> Stepped:
        return Stepped(1.0 / frame)

    def __call__(self, mesh: TriangleMesh) -> np.ndarray:
        return self.shrink * np.where(mesh.vertices[:, 1] > 0.9, 0.05, 0.4)


def test_plain_numbers_are_not_active_and_the_same_everywhere() -> None:
    plain = Thresholds(0.5, 0.1, 1.0)
    assert not plain.active and plain.numbers == (0.5, 0.1, 1.0)
    np.testing.assert_array_equal(plain.fields(BALL), np.tile([0.5, 0.1, 1.0], (len(BALL.vertices), 1)))
    assert plain.at(7, 0.25) is plain


def test_any_callable_will_do_for_each_of_the_three() -> None:
    active = Thresholds(
        lambda mesh: 1.0 + mesh.vertices[:, 0] ** 2,
        lambda mesh: np.float64(0.2),
        lambda mesh: 0.5 + 0.1 * mesh.vertices[:, 1],
        gradation=100.0,
    )
    assert active.active
    fields = active.fields(BALL)
    x, y, _ = BALL.vertices.T
    assert fields.flags.c_contiguous and fields.dtype == np.float64
    np.testing.assert_allclose(fields, np.stack([1 + x**2, np.full_like(x, 0.2), 0.5 + 0.1 * y], axis=1))
    with pytest.raises(UsageError, match="not three numbers"):
        _ = active.numbers


def test_a_minimum_not_given_is_forty_percent_of_the_maximum_everywhere() -> None:
    fields = Thresholds(Stepped()).fields(BALL)
    np.testing.assert_allclose(fields[:, 1], 0.4 * fields[:, 0])
    assert np.ptp(fields[:, 0]) > 0.1


@pytest.mark.parametrize(
    ("thresholds", "says"),
    [
        (Thresholds(lambda m: np.where(np.arange(len(m.vertices)) == 5, np.nan, 1)),
         r"max_edge_length is nan at vertex 5 \(.*\); it must be a positive length"),
        (Thresholds(lambda m: m.vertices[:, 0]), r"max_edge_length is -?[0-9.e-]+ at vertex \d+"),
        (Thresholds(lambda m: 0.2 + 0 * m.vertices[:, 0], 0.15),
         r"min_edge_length 0.15 is 75% of max_edge_length 0.2 at vertex 0 \(.*below 50%.* Try 0.08\."),
        (Thresholds(1.0, lambda m: -1.0), "min_edge_length is -1 at vertex 0"),
        (Thresholds(1.0, None, lambda m: 4.0), "hard_angle is 4 at vertex 0 .* between 0 and pi radians"),
        (Thresholds(lambda m: np.ones((len(m.vertices), 3))), r"shape \(\d+, 3\) for \d+ vertices"),
        (Thresholds(ThresholdFormula("time")), "needs a time"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_with_its_vertex(thresholds: Thresholds, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        thresholds.fields(BALL)


def test_time_enters_frame_by_frame_and_only_where_something_depends_on_it() -> None:
    moving = Thresholds(Stepped(), 0.001)
    assert moving.at(4, 0.1).max_edge_length == Stepped(0.25)
    still = Thresholds(ThresholdFormula("0.1 + 0.01 * x"))
    assert still.at(4, 0.1) is still
    timed = Thresholds(ThresholdFormula("0.1 + time + 0 * frame"))
    now = timed.at(4, 0.5)
    assert now.at(4, 0.5) is now and now != timed
    np.testing.assert_allclose(now.fields(BALL)[:, 0], 0.6)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_graded_lengths_are_the_largest_that_differ_smoothly(seed: int, gradation: float) -> None:
    """The slow twin: the shortest way from every vertex, by relaxing edges until nothing changes."""
    wanted = np.random.default_rng(seed).lognormal(-1.5, 1.0, len(BALL.vertices))
    found = graded(BALL, wanted, gradation)
    ends, rises = edges(BALL), gradation * lengths(BALL)
    slow = wanted.copy()
    for _ in range(len(slow)):
        before = slow.copy()
        np.minimum.at(slow, ends[:, 0], before[ends[:, 1]] + rises)
        np.minimum.at(slow, ends[:, 1], before[ends[:, 0]] + rises)
        if (slow == before).all():
            break
    np.testing.assert_allclose(found, slow, rtol=1e-14)
    assert (np.abs(found[ends[:, 0]] - found[ends[:, 1]]) <= rises * (1 + 1e-12)).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_gradation_does_not_depend_on_the_order_of_faces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = rng.lognormal(-1.5, 1.0, len(BALL.vertices))
    shuffled = TriangleMesh(BALL.vertices, BALL.faces[rng.permutation(len(BALL.faces))])
    assert graded(BALL, wanted, 0.3).tobytes() == graded(shuffled, wanted, 0.3).tobytes()


def test_a_graded_minimum_stays_below_half_of_a_graded_maximum() -> None:
    rng = np.random.default_rng(3)
    wanted = rng.lognormal(-1.5, 1.0, len(BALL.vertices))
    fields = Thresholds(lambda mesh: wanted, lambda mesh: 0.49 * wanted).fields(BALL)
    assert (fields[:, 1] < 0.5 * fields[:, 0]).all()


def test_kernels_compute_the_same_uncompiled() -> None:
    ball = icosphere(3)
    points, faces = np.array(ball.vertices), np.array(ball.faces)
    wanted = np.linspace(0.05, 2.0, len(points))
    fast, slow = wanted.copy(), wanted.copy()
    assert limit_gradation(points, faces, 0.3, fast) == limit_gradation.py_func(points, faces, 0.3, slow)  # type: ignore[attr-defined]
    assert fast.tobytes() == slow.tobytes()
    edge_curvature(points, faces, points, 0.01, fast)
    edge_curvature.py_func(points, faces, points, 0.01, slow)  # type: ignore[attr-defined]
    assert fast.tobytes() == slow.tobytes()


@pytest.mark.parametrize("radius", [0.3, 2.0])
def test_a_ball_is_curved_as_its_radius_says(radius: float) -> None:
    ball = icosphere(12, radius)
    exact = ball.with_attributes(normal=ball.vertices / radius)
    np.testing.assert_allclose(curvature(exact), 1 / radius, rtol=1e-12)
    np.testing.assert_allclose(curvature(ball), 1 / radius, rtol=0.05)


def test_the_tube_of_a_torus_is_what_curves_most() -> None:
    found = curvature(torus(1.0, 0.25, 0.06))
    assert found.min() > 0.8 / 0.25 and found.max() < 1.1 / 0.25


def test_flat_faces_are_flat_up_to_their_creases() -> None:
    assert curvature(box((2, 2, 2), 0.25)).max() < 1e-12
    assert curvature(sheet((2, 2), 0.25)).max() < 1e-12
    tagged = box((2, 2, 2), 0.5)
    soft = curvature(tagged, math.pi)
    assert soft.max() > 1, "without creases the edges of a box are sharp bends"


def test_chords_are_as_high_as_the_tolerance() -> None:
    """Resampled by curvature, the middles of a ball's edges lie within the tolerance of it."""
    radius, tolerance = 1.0, 2e-3
    density = Curvature(tolerance, finest=0.01, coarsest=1.0)
    ball = BALL.with_attributes(normal=BALL.vertices)
    longest = Thresholds(density).fields(ball)[:, 0]
    np.testing.assert_allclose(longest, math.sqrt(8 * tolerance * radius), rtol=1e-12)
    fine = resample(ball, Thresholds(density))[0]
    heights = radius - np.linalg.norm(fine.vertices[edges(fine)].mean(axis=1), axis=1)
    assert heights.max() <= 2.2 * tolerance, "the vertices, put on chords, lie as low again"


def test_the_rim_of_a_thin_sheet_is_refined_however_thin() -> None:
    for thickness in (0.1, 0.02, 0.004):
        disc = ellipsoid(1.0, thickness, 1.0)
        found = Curvature(1e-4, 0.002, 0.2)(disc)
        rim, middle = BALL.vertices[:, 1] == 0, np.abs(BALL.vertices[:, 1]) > 0.9
        assert rim.any() and found[rim].max() < 0.4 * found[middle].min()
        assert found[middle].min() > 0.07


def test_a_crease_is_no_curvature_where_its_normal_is_zero() -> None:
    cube = box((2, 2, 2), 0.25)
    on_edge = (np.abs(cube.vertices) == 1).sum(axis=1) > 1
    normals = np.where(np.abs(cube.vertices) == 1, cube.vertices, 0.0)
    normals[on_edge] = 0.0
    assert curvature(cube.with_attributes(normal=normals)).max() < 1e-12


def test_edges_keep_their_size_in_pixels_as_the_camera_recedes() -> None:
    camera = DistanceToCamera((0.0, 0.0, 5.0), 12.0, 0.001, 10.0, math.radians(40), 960.0)
    found = camera(BALL)
    distance = np.linalg.norm(BALL.vertices - (0, 0, 5), axis=1)
    in_pixels = found / distance / (2 * math.tan(math.radians(20))) * 960
    np.testing.assert_allclose(in_pixels, 12.0)
    clamped = DistanceToCamera((0.0, 0.0, 5.0), 12.0, 0.05, 0.06)(BALL)
    assert clamped.min() >= 0.05 and clamped.max() <= 0.06


@pytest.mark.parametrize(
    "make",
    [
        lambda: Curvature(0.0, 0.1, 1.0),
        lambda: Curvature(0.1, 2.0, 1.0),
        lambda: Curvature(0.1, 0.1, 1.0, 0.0),
        lambda: DistanceToCamera((0, 0, 0), 0.0, 0.1, 1.0),
        lambda: DistanceToCamera((0, 0, 0), 3.0, 0.0, 1.0),
        lambda: DistanceToCamera((0, 0, 0), 3.0, 0.1, 1.0, 4.0),
        lambda: Thresholds(ThresholdFormula("1"), gradation=0.0),
        lambda: ThresholdFormula("1 + q"),
    ],
)
def test_functions_that_cannot_be_are_refused_at_once(make) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UsageError):
        make()


@pytest.mark.parametrize(
    "density",
    [
        ThresholdFormula("0.06 + 0.2 * abs(y)"),
        Curvature(1e-3, 0.02, 0.3),
        DistanceToCamera((1.2, 0, 0), 300, 0.02, 0.4),
    ],
)
def test_after_resampling_every_edge_is_within_its_own_limits(density) -> None:  # type: ignore[no-untyped-def]
    """To within gradation: new vertices take their limits from the ends of the edge they divide."""
    resampler = Resampler(ellipsoid(1.0, 0.5, 0.8), Thresholds(density))
    for _ in range(4):
        report = resampler.resample()
    mesh = resampler.mesh
    limits = resampler.thresholds.fields(mesh)
    a, b = edges(mesh).T
    longest = np.sqrt(limits[a, 0] * limits[b, 0])
    assert validate(mesh).closed
    assert (lengths(mesh) <= 1.02 * longest).mean() > 0.995
    assert report.too_long == 0
    assert np.ptp(lengths(mesh)) > 0.05


def test_a_callable_that_is_constant_gives_the_mesh_of_the_number() -> None:
    plain, report = resample(BALL, Thresholds(0.08))
    active, again = resample(BALL, Thresholds(lambda mesh: np.float64(0.08)))
    assert plain.vertices.tobytes() == active.vertices.tobytes()
    assert plain.faces.tobytes() == active.faces.tobytes()
    assert report == again


def test_edges_are_short_where_the_surface_bends_and_only_along_the_bend() -> None:
    height, longest = 0.002, 0.5

    def on_surface(points: np.ndarray) -> np.ndarray:
        return np.column_stack([points[:, 0], 0.5 * points[:, 0] ** 2, points[:, 2]])

    def bends(mesh: TriangleMesh) -> np.ndarray:
        x = mesh.vertices[:, 0]
        normals = np.column_stack([-x, np.ones(len(x)), np.zeros(len(x))])
        return normals / np.linalg.norm(normals, axis=1, keepdims=True) / (8 * height)

    flat = sheet(edge_length=0.5)
    resampler = Resampler(
        flat.with_vertices(on_surface(flat.vertices)),
        Thresholds(longest, bends=bends),
        Exact(lambda rest: rest, project=on_surface),
    )
    for _ in range(3):
        report = resampler.resample()
    mesh = resampler.mesh
    one, other = mesh.vertices[edges(mesh)].transpose(1, 0, 2)
    over = 0.5 * (one + other)[:, 1] - 0.125 * (one + other)[:, 0] ** 2
    across, along = np.abs(other - one)[:, [0, 2]].max(axis=0)
    assert over.max() < 1.3 * height  # upwards, which is up to 1.4 times as far as to the surface
    assert report.longest <= longest and along > 0.45 > 3 * across
    assert 0.4 * np.sqrt(8 * height) < lengths(mesh).min()
