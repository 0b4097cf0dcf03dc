"""Exact and curved placement: where new vertices come to lie, and what is kept on the way."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.mesh import (
    TriangleMesh,
    box,
    dihedral_angles,
    icosphere,
    rod,
    sheet,
    torus,
    validate,
)
from flowsculpt.pipeline.mesh.analytic_surfaces import AnalyticSurface, SphereSurface, TorusSurface
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Resampler, Thresholds, resample
from flowsculpt.pipeline.resample.placement import ASTRAY, NORMAL, REST
from tests.resample.battery import bipyramid

Motion = Callable[[Points], Points]


def edge_lengths(mesh: TriangleMesh) -> Floats:
    ends = mesh.vertices[mesh.faces]
    return np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).reshape(-1)


def volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def random_motion(seed: int) -> Motion:
    """A rotation, a stretch and shear, and a twist, all of them maps of points that can be told apart."""
    rng = np.random.default_rng(seed)
    rigid, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    linear = rigid @ (np.eye(3) + 0.35 * rng.normal(size=(3, 3)))
    rate = rng.uniform(-1.2, 1.2)

    def move(points: Points) -> Points:
        x, y, z = points.T
        turn = rate * y
        twisted = np.column_stack(
            [x * np.cos(turn) - z * np.sin(turn), y, x * np.sin(turn) + z * np.cos(turn)]
        )
        return twisted @ linear.T

    return move


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["ball", "ring", "cube"]))
def test_all_vertices_lie_where_their_rest_points_are_carried_and_these_on_the_true_surface(
    seed: int, name: str
) -> None:
    subjects: dict[str, tuple[TriangleMesh, AnalyticSurface | None]] = {
        "ball": (icosphere(6), SphereSurface(1.0)),
        "ring": (torus(1.0, 0.4, 0.25), TorusSurface(1.0, 0.4)),
        "cube": (box(edge_length=0.4), None),
    }
    subject, truth = subjects[name]
    move = random_motion(seed)
    thresholds = Thresholds(0.3, max_vertices=100_000)
    resampler = Resampler(subject, thresholds, Exact(move, truth))
    resampler.vertices[:] = move(resampler.vertices)
    report = resampler.resample()
    mesh = resampler.mesh
    exact = mesh.attributes[ASTRAY] == 0
    rest = mesh.attributes[REST]
    assert np.allclose(mesh.vertices[exact], move(rest)[exact], atol=1e-12)
    off = (
        np.abs(np.abs(rest).max(axis=1) - 1) if truth is None else np.linalg.norm(truth(rest) - rest, axis=1)
    )
    assert off[exact].max() < 1e-12
    assert np.count_nonzero(~exact) <= report.on_chord
    assert edge_lengths(mesh).max() <= 0.3
    assert validate(mesh).require(closed=True).euler == validate(subject).require().euler


def turned_aside(points: Points) -> Points:
    """Half a radian about y: at the poles nothing, at the equator two edges of these balls."""
    x, y, z = points.T
    sine, cosine = math.sin(0.5), math.cos(0.5)
    return np.column_stack([x * cosine + z * sine, y, z * cosine - x * sine])


def test_what_would_fold_stays_on_its_chord_and_is_counted() -> None:
    """New points are carried where their neighbours are not: most would fold the surface."""
    ball = icosphere(6)
    resampler = Resampler(
        ball, Thresholds(0.2, 0.0), Exact(turned_aside, SphereSurface(1.0)), min_roundness=0
    )
    report = resampler.resample()
    mesh = resampler.mesh
    astray = mesh.attributes[ASTRAY] > 0
    assert report.on_chord == np.count_nonzero(astray) > 0.5 * report.splits
    born = np.arange(len(mesh.vertices)) >= len(ball.vertices)
    carried = turned_aside(mesh.attributes[REST])
    assert np.allclose(mesh.vertices[born & ~astray], carried[born & ~astray])
    assert np.linalg.norm(mesh.vertices[astray], axis=1).max() < 1, "chords are inside a ball"
    assert report.longest <= 0.2
    assert validate(mesh).require(closed=True).euler == 2


def test_vertices_left_off_the_surface_return_to_it_when_they_can() -> None:
    ball, wild = icosphere(6), [True]

    def carry(points: Points) -> Points:
        return turned_aside(points) if wild else points

    resampler = Resampler(ball, Thresholds(0.2, 0.0), Exact(carry, SphereSurface(1.0)), min_roundness=0)
    resampler.resample()
    mesh = resampler.mesh
    here = mesh.attributes[ASTRAY] == 0
    resampler.vertices[here] = mesh.attributes[REST][here]
    wild.clear()
    resampler.resample()
    left = resampler.mesh.attributes[ASTRAY] > 0
    assert np.count_nonzero(left) < 0.05 * np.count_nonzero(~here)
    assert np.allclose(np.linalg.norm(resampler.vertices[~left], axis=1), 1.0)


@pytest.mark.parametrize("has_normals", [False, True])
def test_carry_is_asked_once_a_pass_for_all_points_and_normals_together(has_normals: bool) -> None:
    """And again for the few points that would fold."""
    calls: list[int] = []

    def carry(points: Points) -> Points:
        calls.append(len(points))
        return points * (3.0, 0.5, 1.0)

    ball = icosphere(8)
    subject = ball.with_attributes(normal=ball.vertices) if has_normals else ball
    resampler = Resampler(subject, Thresholds(0.25), Exact(carry, SphereSurface(1.0)), min_roundness=0)
    resampler.vertices[:] *= (3.0, 0.5, 1.0)
    report = resampler.resample()
    assert report.splits > 500
    assert len(calls) <= 2 * report.passes
    asked = (3 if has_normals else 1) * report.splits  # a normal takes two points more
    assert asked <= sum(calls) <= 1.02 * asked


def test_vertices_that_would_not_improve_their_triangles_are_not_carried() -> None:
    asked = [0]

    def carry(points: Points) -> Points:
        asked[0] += len(points)
        return points * (2.0, 1.0, 0.7)

    resampler = Resampler(icosphere(12), Thresholds(0.25), Exact(carry, SphereSurface(1.0)))
    resampler.vertices[:] *= (2.0, 1.0, 0.7)
    report = resampler.resample()
    assert report.relaxed > 20
    assert asked[0] - report.splits < 2 * report.relaxed


def test_new_normals_are_those_of_the_true_surface_carried() -> None:
    """On an ellipsoid that a ball was stretched to, against its gradient; never of the facets."""
    ball, stretch = icosphere(10), np.array([2.0, 0.6, 1.0])
    resampler = Resampler(
        ball.with_attributes(normal=ball.vertices),
        Thresholds(0.2),
        Exact(lambda p: p * stretch, SphereSurface(1.0)),
    )
    resampler.vertices[:] *= stretch
    normals = resampler.vectors(NORMAL)
    assert normals is not None
    normals[:] = ball.vertices / stretch
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert resampler.resample().splits > 500
    mesh = resampler.mesh
    gradient = mesh.vertices / stretch**2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    here = mesh.attributes[ASTRAY] == 0
    error = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", mesh.attributes[NORMAL], gradient), -1, 1)))
    assert np.median(error[here]) < 0.01
    assert np.quantile(error[here], 0.99) < 0.5


def test_normals_between_two_creases_do_not_lean_as_those_of_the_creases_do() -> None:
    """Faces of a drawn cylinder reach from rim to rim; half-way to a rim its normals are still level."""
    turn = 2.0 * np.pi * np.arange(64) / 64
    rim = np.stack([0.375 * np.cos(turn), np.full(64, 1.0), 0.375 * np.sin(turn)], axis=1)
    points = np.concatenate([rim, rim * (1.0, -1.0, 1.0), [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)]])
    here = np.arange(64)
    to = (here + 1) % 64
    upper, lower = np.stack([here, to, here + 64], axis=1), np.stack([to, to + 64, here + 64], axis=1)
    top, bottom = np.full(64, 128), np.full(64, 129)
    caps = np.stack([to, here, top], axis=1), np.stack([here + 64, to + 64, bottom], axis=1)
    faces = np.concatenate([upper, lower, *caps])
    cylinder = TriangleMesh(points, faces, {NORMAL: np.zeros((130, 3))})
    resampler = Resampler(cylinder, Thresholds(max_edge_length=0.06), Exact(lambda rest: rest))
    resampler.resample()
    mesh = resampler.mesh
    side = np.abs(mesh.vertices[:, 1]) < 0.999
    assert side.sum() > 1000
    assert np.abs(mesh.attributes[NORMAL][side, 1]).max() < 0.02


def cubes_creases(mesh: TriangleMesh) -> int:
    """Count the tagged edges; fail unless all run along an edge of the cube at rest."""
    rest = mesh.attributes[REST]
    one, two = rest[mesh.creases[:, 0]], rest[mesh.creases[:, 1]]
    along = ((np.abs(one) == 1) & (one == two)).sum(axis=1)
    assert (along == 2).all(), "every tagged edge lies on a crease of the cube at rest"
    return len(along)


def test_a_cubes_creases_survive_being_flattened() -> None:
    """Squeezed to a wafer in a shear that hides its edges' angles, and back: all twelve are there whole."""
    cube, at = box(edge_length=0.25), [1.0]

    def carry(points: Points) -> Points:
        return np.column_stack(
            [points[:, 0] + 2 * (1 - at[0]) * points[:, 1], at[0] * points[:, 1], points[:, 2]]
        )

    resampler = Resampler(cube, Thresholds(0.35), Exact(carry))
    for squeeze in [*np.linspace(1, 0.03, 25), *np.linspace(0.03, 1, 25)]:
        at[0] = float(squeeze)
        state = carry(resampler.mesh.attributes[REST])
        resampler.vertices[:] = state
        resampler.resample()
    mesh = resampler.mesh
    assert cubes_creases(mesh) > 0
    ends = mesh.attributes[REST][mesh.creases]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(24)
    assert np.abs(mesh.vertices).max() == pytest.approx(1)


@pytest.mark.parametrize("placement", [Chord(), Curved()])
def test_p31_tagged_edges_survive_whatever_the_flow_does(placement: Placement) -> None:
    """A loop tagged around a ball, soft everywhere: after much stirring it is one closed loop still."""
    ball = icosphere(8)
    edges = np.unique(
        np.sort(np.concatenate([ball.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1), axis=0
    )
    upper = ball.vertices[:, 1] > 0.3
    border = {
        frozenset(pair)
        for face in ball.faces[np.isin(upper[ball.faces].sum(axis=1), [1, 2])].tolist()
        for pair in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0]))
        if upper[list(pair)].all()
    }
    loop = [pair for pair in edges.tolist() if frozenset(pair) in border]
    resampler = Resampler(ball.with_creases(loop), Thresholds(0.25), placement)
    for frame in range(60):
        x, y, z = resampler.vertices.T.copy()
        resampler.vertices[:] = np.column_stack(
            [x + 0.05 * np.sin(2 * y + frame), y + 0.05 * np.sin(2 * z), z + 0.05 * np.sin(3 * x)]
        )
        resampler.resample()
    mesh = resampler.mesh
    degree = np.bincount(mesh.creases.ravel(), minlength=len(mesh.vertices))
    start = np.bincount(np.array(loop).ravel(), minlength=len(ball.vertices))
    assert np.count_nonzero(degree % 2) == np.count_nonzero(start % 2) == 0, "no loose ends"
    assert len(mesh.creases) >= 8
    assert np.median(np.nan_to_num(dihedral_angles(mesh))) < math.radians(40), "it is soft around"


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(-0.5, 0.5))
def test_curved_placement_is_exact_on_planes(stretch: float, shear: float) -> None:
    """Corners of a boundary that turn by 60 degrees or more stay corners; blunter ones would be rounded."""
    cloth = sheet((2, 2), 0.3)
    points = cloth.vertices * (stretch, 1, 1)
    points[:, 2] += shear * points[:, 0]
    mesh, report = resample(cloth.with_vertices(points), Thresholds(0.2), Curved())
    assert report.splits > 0
    assert np.abs(mesh.vertices[:, 1]).max() == 0
    assert np.allclose(mesh.bounds, [points.min(axis=0), points.max(axis=0)])


def test_on_a_ball_curved_placement_errs_a_tenth_of_the_chord_at_most() -> None:
    ball = icosphere(5)
    errors = {}
    for name, placement in {"chord": Chord(), "curved": Curved()}.items():
        mesh, _ = resample(ball, Thresholds(0.2), placement)
        off = np.linalg.norm(mesh.vertices, axis=1) - 1
        errors[name] = float(np.sqrt(np.mean(off**2)))
    assert errors["curved"] < 0.1 * errors["chord"]


def test_a_spike_in_compression_keeps_its_length() -> None:
    """A rod, drawn along and squeezed across until it is a needle, has its tips where the flow took them."""
    at = [1.0]

    def carry(points: Points) -> Points:
        return points * (at[0] ** -0.5, at[0], at[0] ** -0.5)

    needle = rod(2.0, 0.3, 0.1)
    resampler = Resampler(needle, Thresholds(0.16), Exact(carry))
    for stretch in np.geomspace(1, 12, 60):
        at[0] = float(stretch)
        resampler.vertices[:] = carry(resampler.mesh.attributes[REST])
        resampler.resample()
    assert np.ptp(resampler.vertices[:, 1]) > 0.99 * 24
    assert validate(resampler.mesh).require(closed=True).euler == 2


def squeezed(shape: float) -> float:
    """The roundness that a hundredth of the triangles fall short of, after a ball was stirred."""
    ball, frames = icosphere(10), [0]

    def carry(points: Points) -> Points:
        for frame in range(frames[0]):
            x, y, z = points.T
            points = np.column_stack([x + 0.03 * np.sin(2 * y + frame), y + 0.03 * np.sin(2 * z), z])
        return points

    resampler = Resampler(ball, Thresholds(0.25), Exact(carry, SphereSurface(1.0)), shape)
    for _ in range(20):
        frames[0] += 1
        resampler.vertices[:] = carry(resampler.mesh.attributes[REST])
        resampler.resample()
    a, b, c = (np.roll(edge_lengths(resampler.mesh).reshape(-1, 3), i, axis=1)[:, 0] for i in range(3))
    return float(np.quantile((b + c - a) * (c + a - b) * (a + b - c) / (a * b * c), 0.01))


def test_p36_a_demand_for_rounder_triangles_is_met() -> None:
    as_it_comes, usual, demanding = (squeezed(shape) for shape in (0.0, 0.6, 0.85))
    assert as_it_comes < usual < demanding
    assert demanding > 0.65


@pytest.mark.parametrize("placement", [Curved(), Exact(lambda rest: rest)])
@pytest.mark.parametrize("height", [0.2, 0.5, 1.0, 4.0, 10.0])
def test_cones_stay_cones(placement: Placement, height: float) -> None:
    """Two cones base to base, of 60 long faces each: their slopes are straight, whatever their angle.

    The rims of the last two turn by 28 and 11 degrees, less than the hard angle.
    """
    cones = bipyramid(60, height)
    mesh, report = resample(cones, Thresholds(0.25), placement)
    assert report.splits > 100
    assert volume(mesh) == pytest.approx(volume(cones), rel=0.01)


def test_long_faces_at_the_poles_of_a_globe_stay_round() -> None:
    """64 meridians and 16 parallels: faces at the poles are ten times as long as wide."""
    meridians, parallels = 64, 16
    east = 2 * np.pi * np.arange(meridians) / meridians
    south = np.repeat(np.pi * np.arange(1, parallels) / parallels, meridians)
    ring = np.column_stack([np.tile(np.cos(east), parallels - 1), np.tile(np.sin(east), parallels - 1)])
    points = np.column_stack([ring * np.sin(south)[:, None], np.cos(south)])
    here = np.arange(meridians)
    there, last = np.roll(here, -1), len(points) - meridians
    rows = meridians * np.arange(parallels - 2)[:, None]
    a, b = (rows + here).ravel(), (rows + there).ravel()
    sides = [(a, a + meridians, b), (b, a + meridians, b + meridians)]
    poles = [(np.full(meridians, len(points)), here, there)]
    poles += [(last + there, last + here, np.full(meridians, len(points) + 1))]
    faces = np.concatenate([np.column_stack(corners) for corners in sides + poles])
    globe = TriangleMesh(np.vstack([points, [[0, 0, 1], [0, 0, -1]]]), faces.astype(np.int32))
    mesh, report = resample(globe, Thresholds(0.1), Exact(lambda rest: rest))
    assert report.splits > 200
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(1.0, abs=0.0005)
