"""The surface at rest: nothing turns over there, and places on it are found by where they are now."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray, Indices, Points
from flowsculpt.pipeline.mesh import (
    HalfedgeMesh,
    TriangleMesh,
    box,
    dihedral_angles,
    icosphere,
    sheet,
    torus,
    validate,
)
from flowsculpt.pipeline.mesh.analytic_surfaces import SphereSurface
from flowsculpt.pipeline.mesh.normals import vertex_normals
from flowsculpt.pipeline.resample import Curved, Exact, Resampler, Thresholds
from flowsculpt.pipeline.resample.kernels.flip import should_flip, untangle
from flowsculpt.pipeline.resample.kernels.pass_state import (
    Limits,
    collect_ring,
    move_at_rest,
    new_ring,
    rest_orientation,
    would_flip,
)
from flowsculpt.pipeline.resample.kernels.rest_surface import MAX_OPPOSITE, opposite_corners
from flowsculpt.pipeline.resample.placement import ASTRAY, REST, closest_points
from flowsculpt.pipeline.resample.resample_pass import changes_of, reset

BALL, RING, CLOTH, CUBE = icosphere(4), torus(1.0, 0.4, 0.3), sheet((2, 2), 0.25), box(edge_length=0.5)


def at_rest(mesh: TriangleMesh, rest: Points) -> tuple[HalfedgeMesh, Limits]:
    """A mesh with those places at rest, its normals as they are, and limits that let everything be."""
    live = HalfedgeMesh(mesh.with_attributes(rest=rest, rest_normal=vertex_normals(mesh)))
    columns = live.column("rest"), live.column("rest_normal")
    return live, Limits(math.inf, 0.0, -2.0, True, -1, 1.0, *columns)


def slow_upright(rest: Points, normals: Points, face: Indices) -> float:
    a, b, c = rest[face]
    return float(np.cross(b - a, c - a) @ normals[face].sum(axis=0))


def spokes_of(mesh: TriangleMesh) -> dict[int, int]:
    return {int(v): h for h, v in reversed(list(enumerate(mesh.faces.ravel())))}


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([BALL, RING, CLOTH]), st.integers(0, 2**32 - 1))
def test_a_vertex_moves_at_rest_only_if_no_more_faces_look_inwards_then(
    mesh: TriangleMesh, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rest = mesh.vertices + 0.1 * rng.normal(size=mesh.vertices.shape)
    (live, limits), ring, normals = at_rest(mesh, rest), new_ring(), vertex_normals(mesh)
    carried = live.arrays.attributes
    for v, spoke in list(spokes_of(mesh).items())[:40]:
        faces = mesh.faces[(mesh.faces == v).any(axis=1)]
        for face in faces:
            value = rest_orientation(carried, limits, *(int(k) for k in face))
            assert value == pytest.approx(slow_upright(rest, normals, face), abs=1e-12)
        goal = rest[v] + 0.3 * rng.normal(size=3)
        after = rest.copy()
        after[v] = goal
        was, then = (sum(slow_upright(p, normals, face) <= 0 for face in faces) for p in (rest, after))
        assert collect_ring(live.arrays, spoke, ring)
        assert move_at_rest(carried, ring, v, goal[None], 0, limits) == (then <= was)
        rest = after if then <= was else rest
        assert np.array_equal(live.attributes()["rest"], rest)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([BALL, RING, CLOTH]), st.integers(0, 2**32 - 1))
def test_a_merge_overturns_if_a_face_that_stays_turns_to_look_inwards(mesh: TriangleMesh, seed: int) -> None:
    rest = mesh.vertices + 0.1 * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    (live, limits), ring, normals = at_rest(mesh, rest), new_ring(), vertex_normals(mesh)
    for v, spoke in list(spokes_of(mesh).items())[:40]:
        assert collect_ring(live.arrays, spoke, ring)
        other = int(ring.vertex[0])
        faces = mesh.faces[(mesh.faces == v).any(axis=1) & (mesh.faces != other).all(axis=1)]
        merged = np.where(faces == v, other, faces)
        turns = any(
            slow_upright(rest, normals, now) <= 0 < slow_upright(rest, normals, before)
            for before, now in zip(faces, merged, strict=True)
        )
        assert would_flip(live.arrays.attributes, ring, v, other, limits) == turns


def test_an_edge_is_not_turned_where_its_faces_at_rest_would_overlap() -> None:
    """Now a flat kite whose long diagonal is worth turning; at rest an arrow head, for which it is not."""
    now = np.array([(0, 0, 0), (4, 0, 0), (2, 0, -1), (2, 0, 1)], float)
    faces = [(0, 1, 2), (1, 0, 3)]
    kite = TriangleMesh(now, faces)
    for tip, worth in ((2.0, True), (6.0, False)):
        rest = now.copy()
        rest[2:, 0] = tip
        live, limits = at_rest(kite, rest)
        assert should_flip(live.arrays, 0, limits) == worth


def test_an_edge_is_flipped_where_a_face_looks_inwards_at_rest_and_then_none_does() -> None:
    """Now a flat kite; at rest an arrow head too, which only the diagonal from its notch cuts well."""
    now = np.array([(0, 0, 0), (4, 0, 0), (2, 0, -1.5), (2, 0, 1.5)], float)
    kite = TriangleMesh(now, [(0, 1, 2), (1, 0, 3)])
    for notch, flips in ((-1.5, 0), (0.5, 1)):
        rest = now.copy()
        rest[2, 2] = notch
        live, limits = at_rest(kite, rest)
        changes = changes_of(live)
        reset(changes)
        assert untangle(live.arrays, np.arange(2, dtype=np.int32), limits, changes) == (flips, 0)
        upright = [slow_upright(rest, vertex_normals(kite), face) > 0 for face in live.snapshot().faces]
        assert all(upright)
        assert changes.fresh[0] == 2 * flips


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([BALL, RING, CLOTH]), st.integers(0, 2**32 - 1))
def test_untangling_leaves_fewer_faces_that_look_inwards_at_rest_and_a_sound_surface(
    mesh: TriangleMesh, seed: int
) -> None:
    rest = mesh.vertices + 0.1 * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    (live, limits), normals = at_rest(mesh, rest), vertex_normals(mesh)
    changes = changes_of(live)
    reset(changes)

    def inwards() -> int:
        return sum(slow_upright(rest, normals, face) <= 0 for face in live.snapshot().faces)

    before = inwards()
    turned, left = untangle(live.arrays, np.arange(len(mesh.faces), dtype=np.int32), limits, changes)
    after = live.snapshot()
    assert inwards() <= min(before - turned, left + turned)
    assert validate(after).require().euler == validate(mesh).require().euler
    assert (dihedral_angles(after) > math.radians(170)).sum() == 0, "nothing folds now"


def test_around_a_vertex_lie_its_faces_and_on_a_crease_only_the_edges_along_it() -> None:
    def around(mesh: TriangleMesh, v: int) -> set[tuple[int, int]]:
        live, found = HalfedgeMesh(mesh), np.empty((1, MAX_OPPOSITE, 2), np.int32)
        opposite_corners(live.arrays, np.array([spokes_of(mesh)[v]], np.int32), new_ring(), found)
        return {(int(a), int(b)) for a, b in found[0] if a >= 0}

    def beside(mesh: TriangleMesh, v: int) -> set[tuple[int, int]]:
        at = [(face.tolist(), face.tolist().index(v)) for face in mesh.faces if v in face]
        return {(face[(i + 1) % 3], face[(i + 2) % 3]) for face, i in at}

    assert around(BALL, 20) == beside(BALL, 20)
    rim = int(np.flatnonzero((np.abs(CLOTH.vertices) == 1).sum(axis=1) == 1)[0])
    assert len(around(CLOTH, rim)) == 2 and all(a == b for a, b in around(CLOTH, rim))
    ends = CLOTH.faces[:1, :2]
    v = int(ends[0, 0])
    tagged = around(CLOTH.with_creases(ends), v)
    assert (int(ends[0, 1]), int(ends[0, 1])) in tagged


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_nearest_place_is_as_near_as_a_fine_search_finds(seed: int, alone: bool) -> None:
    rng = np.random.default_rng(seed)
    shear, wave = rng.uniform(-2, 2), rng.uniform(-1, 1)

    def carried(points: Points) -> Points:
        x, y, z = points.T
        return np.column_stack([x + shear * y + wave * np.sin(2 * y), y, z + 0.3 * x * x])

    turns = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    rim = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    corners = np.full((1, MAX_OPPOSITE, 2, 3), np.nan)
    corners[0, :6, 0], corners[0, :6, 1] = rim, np.roll(rim, -1, axis=0)
    if alone:  # a crease
        corners[0, 1:] = np.nan
        corners[0, 0, 1] = corners[0, 0, 0]
    goal = carried(np.array([[0.3, 0.2, 0.0]])) + 0.1 * rng.normal(size=(1, 3))
    found, place = closest_points(lambda p, _: carried(p), lambda p, _: p, np.zeros((1, 3)), corners, goal)
    assert np.allclose(carried(found), place)
    u, v = rng.uniform(size=(2, 20_000))
    inside = rim[0] * np.sqrt(u)[:, None] if alone else np.column_stack([*_in_disc(u, v), 0 * u])
    best = np.linalg.norm(carried(inside) - goal, axis=1).min()
    assert np.linalg.norm(place - goal) < best + (0.35 if alone else 0.1)
    if alone:
        assert abs(found[0, 1]) < 1e-12 and 0 <= found[0, 0] <= 1, "it stays on the crease"


def _in_disc(u: AnyArray, v: AnyArray) -> tuple[AnyArray, AnyArray]:
    return 0.86 * np.sqrt(u) * np.cos(2 * np.pi * v), 0.86 * np.sqrt(u) * np.sin(2 * np.pi * v)


def sheared(points: Points, much: float) -> Points:
    x, y, z = points.T
    return np.column_stack([x + much * np.sin(3 * y), y, z + 0.7 * much * np.sin(2 * x + much)])


def test_a_ball_that_flows_there_and_back_comes_back_without_a_fold() -> None:
    """The middles of edges at rest are far from those now, and edges are turned and merged many times."""
    now = [0.0]

    def carry(points: Points) -> Points:
        return sheared(points, now[0])

    ball, truth = icosphere(6), SphereSurface(1.0)
    resampler = Resampler(ball, Thresholds(0.25), Exact(carry, truth))
    for much in [*np.linspace(0, 1, 24), *np.linspace(1, 0, 24)]:
        now[0] = float(much)
        resampler.vertices[:] = carry(resampler.mesh.attributes[REST])
        resampler.resample()
        volumes = np.linalg.det(resampler.mesh.attributes[REST][resampler.mesh.faces])
        assert np.count_nonzero(volumes <= 0) <= 2, "a merge may, where an edge would else stay short"
    mesh = resampler.mesh
    assert not mesh.attributes[ASTRAY].any()
    assert np.allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0)
    assert np.linalg.det(mesh.vertices[mesh.faces]).min() > 0


@pytest.mark.parametrize("placement", [Curved(), Exact(lambda points: points)], ids=["curved", "exact"])
def test_the_long_faces_of_a_cone_stay_straight_up_to_its_tip(placement: Curved | Exact) -> None:
    sides, height, radius = 48, 2.0, 0.3
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = np.column_stack([radius * np.cos(angle), np.zeros(sides), radius * np.sin(angle)])
    around = [(i, (i + 1) % sides) for i in range(sides)]
    faces = [(i, sides, j) for i, j in around] + [(i, j, sides + 1) for i, j in around]
    cone = TriangleMesh(np.vstack([rim, [[0, height, 0], [0, 0, 0]]]), np.array(faces, np.int32))
    sculpture = Resampler(cone, Thresholds(max_edge_length=0.06), placement=placement)
    sculpture.resample()
    points = sculpture.mesh.vertices[sculpture.mesh.vertices[:, 1] > 0.1]
    bulge = np.hypot(points[:, 0], points[:, 2]) - radius * (1 - points[:, 1] / height)
    assert bulge.max() < 0.001 * radius
