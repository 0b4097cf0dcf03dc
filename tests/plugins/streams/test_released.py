"""What seeds release: stream, path and streak surfaces and lines, against integration point by point."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from flowsculpt import (
    DoubleGyre,
    FrameError,
    Rotation,
    Streamlines,
    Sum,
    Thresholds,
    Translation,
    TriangleMesh,
    VelocityField,
    keyed,
    validate,
    vertex_normals,
)
from flowsculpt.api.flows import TriangleTree
from flowsculpt.api.meshes import Floats, connected_components
from flowsculpt.pipeline.flow.catalogue.basic import ABC, Strain
from flowsculpt.pipeline.plugins.streams.released_lines import PathLines, ReleasedLines, StreakLines
from flowsculpt.pipeline.plugins.streams.released_surfaces import (
    HEIGHT,
    PathSurface,
    ReleasedSurface,
    StreakSurface,
)
from flowsculpt.pipeline.plugins.streams.seed_curves import SeedCircle, SeedCurve, Seeds
from flowsculpt.pipeline.plugins.streams.seed_placement import REST
from flowsculpt.pipeline.plugins.streams.sheet_cuts import cut_below, stretches
from flowsculpt.pipeline.plugins.streams.shells import shell
from flowsculpt.pipeline.plugins.streams.travels import Frozen

LINE = SeedCurve(np.array([[-0.5, 0.1, 0.2], [0.5, 0.1, 0.2]]))
UPRIGHT = SeedCurve(np.array([[-0.4, 0.15, -0.4], [-0.3, 0.15, 0.4]]))
CIRCLE = SeedCircle(np.array([0.1, 0.2, 0.0]), 0.4, np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]))
SWINGING = Sum((DoubleGyre(), Translation(rate=keyed((0.0, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.4))))))
LONGEST, SECONDS = 0.1, 0.8

CASES = {
    "steady line": (LINE, ABC()),
    "changing line": (UPRIGHT, SWINGING),
    "steady circle": (CIRCLE, ABC()),
    "changing circle": (CIRCLE, SWINGING),
}


def grown(
    kind: type[ReleasedSurface],
    seeds: Seeds,
    field: VelocityField,
    tear: float = math.inf,
    longest: float = LONGEST,
) -> ReleasedSurface:
    surface = kind(seeds, Streamlines(field), 0.0, Thresholds(longest), tear, tolerance=HEIGHT * LONGEST)
    for step in range(1, 21):
        surface.grow(SECONDS * step / 20)
    return surface


@cache
def shown(kind: type[ReleasedSurface], case: str) -> ReleasedSurface:
    return grown(kind, *CASES[case])


def carried(field: VelocityField, point: Floats, start: float, stop: float) -> Floats:
    """Return where a point (3,) is carried, by many sub-steps of the classical Runge-Kutta method."""
    count = 60
    h, x = (stop - start) / count, point[None]
    for k in range(count):
        t = start + k * h
        one = field.velocity(x, t)
        two = field.velocity(x + h / 2 * one, t + h / 2)
        three = field.velocity(x + h / 2 * two, t + h / 2)
        four = field.velocity(x + h * three, t + h)
        x = x + h / 6 * (one + 2 * two + 2 * three + four)
    return x[0]


def lengths_of_edges(mesh: TriangleMesh) -> Floats:
    ends = np.concatenate([mesh.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    return np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)


def distances(points: Floats, mesh: TriangleMesh) -> Floats:
    corners = np.ascontiguousarray(mesh.vertices[mesh.faces])
    face, shares = TriangleTree.of(corners).nearest(np.ascontiguousarray(points))
    weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
    return np.linalg.norm(np.einsum("nk,nkj->nj", weights, corners[face]) - points, axis=1)


def pieces(mesh: TriangleMesh) -> int:
    roots = connected_components(
        len(mesh.vertices), mesh.faces[:, [0, 1]].ravel(), mesh.faces[:, [1, 2]].ravel()
    )
    return len(np.unique(roots[mesh.faces]))


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
@pytest.mark.parametrize("case", CASES)
def test_vertices_are_where_integration_from_their_seed_puts_them(
    kind: type[ReleasedSurface], case: str
) -> None:
    (seeds, field), surface = CASES[case], shown(kind, case)
    inner = surface._resampler.mesh
    exact = np.flatnonzero(inner.attributes["astray"] == 0)
    assert len(exact) >= 0.99 * len(inner.vertices)
    rest = inner.attributes[REST]
    along, times = surface.coordinates.along(rest), surface.coordinates.times(rest)
    for vertex in np.random.default_rng(1).choice(exact, 25):
        seed, time = seeds.points(along[[vertex]])[0], float(times[vertex])
        span = (time, SECONDS) if kind is StreakSurface else (0.0, time)
        assert np.linalg.norm(carried(field, seed, *span) - inner.vertices[vertex]) < 1e-6


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
def test_vertices_are_exact_where_a_saddle_stretches_the_front_a_thousand_times(
    kind: type[ReleasedSurface],
) -> None:
    field = Frozen(Sum((DoubleGyre(), Translation(rate=(0.0, 0.0, 0.1)))), 0.4)
    surface = kind(LINE, Streamlines(field), 0.0, Thresholds(0.2))
    for frame in range(1, 25):
        surface.grow(3.0 * frame / 24)
    inner, carry = surface._resampler.mesh, surface.carry
    along = surface.coordinates.along(inner.attributes[REST])
    late = np.abs(surface.coordinates.times(inner.attributes[REST]) - (3.0 if kind is PathSurface else 0.0))
    seeds = np.sort(along[late < 1e-9])
    assert 0.0 < np.diff(seeds).min() < 0.2 / 1000  # no seed twice in the row that moves on
    assert (inner.attributes["astray"] == 0).mean() > 0.999
    off = np.linalg.norm(carry(inner.attributes[REST]) - inner.vertices, axis=1)
    assert off[inner.attributes["astray"] == 0].max() < 1e-5
    assert lengths_of_edges(inner).max() <= 0.2


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
@pytest.mark.parametrize("case", CASES)
def test_surfaces_are_sound_and_no_edge_is_longer_than_it_may_be(
    kind: type[ReleasedSurface], case: str
) -> None:
    mesh = shown(kind, case).mesh
    assert validate(mesh).problem is None and pieces(mesh) == 1
    assert lengths_of_edges(mesh).max() <= LONGEST
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
def test_a_row_that_moves_on_leaves_edges_behind_that_are_more_than_half_as_long_as_they_may_be(
    kind: type[ReleasedSurface],
) -> None:
    mesh = grown(kind, LINE, Translation(rate=(0.0, 1.0, 0.0))).mesh
    ends = np.concatenate([mesh.vertices[mesh.faces[:, pair]] for pair in ([0, 1], [1, 2], [2, 0])])
    steps = np.abs(ends[:, 1] - ends[:, 0])
    along = steps[steps[:, 1] > 3.0 * steps[:, 0], 1]
    assert np.median(along) > 0.6 * LONGEST


def lengths_and_heights(surface: ReleasedSurface) -> tuple[Floats, Floats]:
    """Return lengths (E,) of edges, and how far their middles are from the surface, by its normals."""
    inner = surface._resampler.mesh
    normals = surface._normals(inner)
    ends = np.concatenate([inner.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    one, other = inner.vertices[ends].transpose(1, 0, 2)
    turns = normals[ends[:, 1]] - normals[ends[:, 0]]
    heights = np.abs(((other - one) * turns).sum(axis=1)) / 8.0
    return np.linalg.norm(other - one, axis=1), heights


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
@pytest.mark.parametrize("case", CASES)
def test_edges_are_near_the_surface_where_it_is_curved(kind: type[ReleasedSurface], case: str) -> None:
    surface = shown(kind, case)
    inner = surface._resampler.mesh
    alike = np.abs((surface._normals(inner) * vertex_normals(inner)).sum(axis=1))
    assert np.quantile(alike, 0.05) > 0.98, "they are those of the surface"
    _, heights = lengths_and_heights(surface)
    assert np.quantile(heights, 0.95) < HEIGHT * LONGEST


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
@pytest.mark.parametrize("case", ["steady line", "changing circle"])
def test_with_a_larger_maximum_flat_parts_are_coarser_and_bends_as_near(
    kind: type[ReleasedSurface], case: str
) -> None:
    coarse = grown(kind, *CASES[case], longest=4.0 * LONGEST)
    lengths, heights = lengths_and_heights(coarse)
    assert LONGEST < lengths.max() <= 4.0 * LONGEST
    assert np.quantile(heights, 0.95) < HEIGHT * LONGEST
    level = Translation(rate=(0.0, 1.0, 0.0))
    few, many = (grown(kind, LINE, level, longest=each * LONGEST).mesh.vertices for each in (4.0, 1.0))
    assert len(few) < 0.25 * len(many)


def test_the_newest_row_of_a_streak_surface_is_on_its_seeds_and_the_oldest_of_a_path_surface_moves() -> None:
    streak, path = shown(StreakSurface, "changing line"), shown(PathSurface, "changing line")
    newest, still = streak._row(SECONDS), path._row(0.0)
    for surface, row in ((streak, newest), (path, still)):
        points = surface.mesh.vertices[row]
        ends = UPRIGHT.through
        assert np.allclose(np.cross(points - ends[0], ends[1] - ends[0]), 0.0, atol=1e-12)
        assert (surface.velocities()[row] == 0.0).all()
    front = path._row(SECONDS)
    assert np.allclose(path.velocities()[front], SWINGING.velocity(path.mesh.vertices[front], SECONDS))
    assert len(newest) > 8 and len(front) > 8


def test_in_steady_velocities_a_streak_surface_is_the_path_surface() -> None:
    path, streak = (shown(kind, "steady circle").mesh for kind in (PathSurface, StreakSurface))
    for one, other in ((path, streak), (streak, path)):
        assert distances(one.vertices, other).max() < 0.2 * LONGEST


def test_a_stream_surface_grows_both_ways_and_as_the_velocities_are_at_one_time() -> None:
    field = Frozen(SWINGING, 0.5)
    surface = PathSurface(UPRIGHT, Streamlines(field), 0.5, Thresholds(LONGEST))
    surface.grow(1.1)
    surface.grow_back(0.1)
    rest = surface._resampler.mesh.attributes[REST]
    times = surface.coordinates.times(rest)
    assert np.isclose(times.min(), -0.4) and np.isclose(times.max(), 0.6)
    vertex = int(times.argmin())
    seed = UPRIGHT.points(surface.coordinates.along(rest[[vertex]]))[0]
    assert np.allclose(carried(field, seed, 0.0, -0.4), surface.mesh.vertices[vertex], atol=1e-8)
    assert validate(surface.mesh).problem is None and pieces(surface.mesh) == 1


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface])
def test_a_front_that_a_saddle_stretches_is_torn_where_the_shot_says(kind: type[ReleasedSurface]) -> None:
    seeds = SeedCurve(np.array([[-0.05, 0.5, -0.3], [0.05, 0.5, 0.3]]))
    saddle = Sum((Strain(axis=(1.0, 0.0, 0.0), rate=4.0), Rotation(speed=0.2)))
    whole, torn = grown(kind, seeds, saddle), grown(kind, seeds, saddle, tear=3.0)
    mesh = torn.mesh
    assert validate(mesh).problem is None
    assert stretches(mesh.vertices, torn._flat(torn._resampler.mesh), mesh.faces).max() <= 3.0
    flat = whole._flat(whole._resampler.mesh)
    assert stretches(whole.mesh.vertices, flat, whole.mesh.faces).max() > 3.0
    assert np.ptp(mesh.vertices[:, 0]) < np.ptp(whole.mesh.vertices[:, 0])


def test_points_of_a_streak_that_have_travelled_long_enough_are_left_out() -> None:
    for seeds, field in CASES.values():
        surface = StreakSurface(seeds, Streamlines(field), 0.0, Thresholds(LONGEST), length=0.4)
        lines = StreakLines(seeds, Streamlines(field), 0.0, 3, LONGEST, 0.02, length=0.4)
        for step in range(1, 21):
            surface.grow(SECONDS * step / 20)
            lines.grow(SECONDS * step / 20)
        mesh = surface.mesh
        assert validate(mesh).problem is None and pieces(mesh) == 1
        assert lengths_of_edges(mesh).max() <= LONGEST
        inner = surface._resampler.mesh
        times = surface.coordinates.times(inner.attributes[REST])
        assert np.isclose(times.min(), SECONDS - 0.4) and np.isclose(times.max(), SECONDS)
        exact = inner.attributes["astray"] == 0
        away = np.linalg.norm(surface.carry(inner.attributes[REST]) - inner.vertices, axis=1)
        assert away[exact].max() < 1e-6
        assert np.isclose(lines._times[0], SECONDS - 0.4) and len(lines._points) == len(lines._times)


def test_a_surface_is_cut_at_a_height() -> None:
    rng = np.random.default_rng(3)
    flat = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0), indexing="ij"), -1).reshape(-1, 2)
    corner = (9 * np.arange(8)[:, None] + np.arange(8)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 9, corner + 10], 1), np.stack([corner, corner + 10, corner + 1], 1)]
    )
    sheet = TriangleMesh(
        np.column_stack([flat, rng.normal(0.0, 0.2, 81)]), faces, {"height": flat[:, 0] + 0.0}
    )
    for limit in (2.5, 3.0, 3.25):
        part = cut_below(sheet, sheet.attributes["height"] + 0.1 * flat[:, 1], limit)
        heights = part.attributes["height"] + 0.1 * part.vertices[:, 1]
        assert validate(part).problem is None and heights.min() > limit - 1e-12
        a, b, c = part.vertices[part.faces][:, :, :2].transpose(1, 0, 2)
        (ux, uy), (vx, vy) = (b - a).T, (c - a).T
        areas = 0.5 * (ux * vy - uy * vx)
        assert (areas > -1e-12).all()
        assert np.isclose(areas.sum(), 64.0 - 8.0 * (limit - 0.4))


def test_a_shell_is_closed_and_as_thick_as_it_should_be() -> None:
    mesh = shown(StreakSurface, "steady line").mesh
    thick = shell(mesh, 0.02)
    report = validate(thick)
    assert report.problem is None and report.closed
    count = len(mesh.vertices)
    assert np.allclose(np.linalg.norm(thick.vertices[:count] - thick.vertices[count:], axis=1), 0.02)
    assert np.allclose(thick.attributes["material"][:, 1], np.repeat([0.01, -0.01], count))


@pytest.mark.parametrize("kind", [PathLines, StreakLines])
@pytest.mark.parametrize("flatten", [1.0, 0.1])
def test_lines_are_closed_tubes_along_exact_points(kind: type[ReleasedLines], flatten: float) -> None:
    lines = kind(UPRIGHT, Streamlines(SWINGING), 0.0, 5, LONGEST, 0.02, flatten)
    for step in range(1, 21):
        lines.grow(SECONDS * step / 20)
    mesh = lines.mesh
    report = validate(mesh)
    assert report.problem is None and report.closed and pieces(mesh) == 5
    points = lines._points
    assert np.linalg.norm(np.diff(points, axis=0), axis=2).max() <= LONGEST * (1 + 1e-9)
    seeds = UPRIGHT.points(lines.along)
    for row in (0, len(points) // 2, len(points) - 1):
        time = lines._times[row]
        span = (time, SECONDS) if kind is StreakLines else (0.0, time)
        for line in (0, 3):
            assert np.allclose(carried(SWINGING, seeds[line], *span), points[row, line], atol=1e-6)
    row = len(points) // 2
    rings = mesh.vertices[lines._rows == row].reshape(5, 12, 3)
    assert np.allclose(rings.mean(axis=1), points[row])
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert np.einsum("ij,ij->i", np.cross(a, b), c).sum() > 0.0


@pytest.mark.parametrize(
    ("speed", "seconds", "fault"),
    [
        (1.0, 1e9, r"1 units a second, which takes over 30,000 steps of 0\.1 units"),
        (1e9, 1.0, r"1e\+09 units a second, which takes over 30,000 steps of 0\.1 units"),
        (math.inf, 1.0, "a velocity is inf; it must be finite"),
    ],
    ids=["long", "fast", "infinite"],
)
@pytest.mark.parametrize("kind", [PathLines, StreakLines])
def test_lines_that_need_too_many_steps_fail_at_once(
    kind: type[ReleasedLines], speed: float, seconds: float, fault: str
) -> None:
    lines = kind(UPRIGHT, Streamlines(Translation((speed, 0.0, 0.0))), 0.0, 3, LONGEST, 0.01)
    with pytest.raises(FrameError, match=fault):
        lines.grow(seconds)


def test_points_that_slow_down_take_few_steps_however_fast_they_begin() -> None:
    slowing = Translation(rate=keyed((0.0, 0.001), ((1000.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    lines = PathLines(UPRIGHT, Streamlines(slowing), 0.0, 3, LONGEST, 0.01)
    lines.grow(2.0)
    assert len(lines.travel.steps) < 50


def test_curves_of_seeds_go_through_their_points_at_an_even_pace() -> None:
    through = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 1]], float)
    for closed in (False, True):
        for smooth in (False, True):
            curve = SeedCurve(through, closed, smooth)
            points = curve.points(np.linspace(0.0, curve.length, 2001))
            assert all(np.linalg.norm(points - each, axis=1).min() < 2e-3 for each in through)
            assert np.allclose(points[0], through[0]) and np.allclose(
                points[-1], through[0 if closed else -1]
            )
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            assert (
                steps.max() < 1.1 * steps.min()
                if smooth
                else np.allclose(steps, curve.length / 2000, rtol=0.5)
            )
