"""Collapsing, mending and the tables beneath, against twins that search and sort."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, box, icosphere, rod, sheet, torus, validate
from flowsculpt.pipeline.mesh.halfedge_mesh import CREASE
from flowsculpt.pipeline.resample.kernels.collapse import (
    AT_END,
    AT_START,
    FEATURE,
    NONE,
    SHAPE,
    can_collapse,
    collapse_edge,
    removal_distance,
    swept_volume,
)
from flowsculpt.pipeline.resample.kernels.flip import flip_edge
from flowsculpt.pipeline.resample.kernels.pass_state import (
    Limits,
    Ring,
    collect_ring,
    folds,
    measure_ring,
    new_ring,
)
from flowsculpt.pipeline.resample.kernels.split import split_edge

HARD = math.cos(math.radians(40))
BALL, CUBE, RING, CLOTH = icosphere(3), box(edge_length=0.5), torus(1.0, 0.4, 0.3), sheet((2, 2), 0.5)


def limits(longest: float = math.inf, cosine: float = HARD, midpoints: bool = True) -> Limits:
    return Limits(longest, math.inf, cosine, midpoints)


def ring_of(live: HalfedgeMesh, h: int, cosine: float = HARD) -> Ring:
    ring = new_ring()
    assert collect_ring(live.arrays, h, ring)
    measure_ring(live.arrays, int(live.arrays.vert[h]), ring, cosine)
    return ring


def ends_of(mesh: TriangleMesh, h: int) -> tuple[int, int]:
    return int(mesh.faces[h // 3, h % 3]), int(mesh.faces[h // 3, (h + 1) % 3])


@pytest.mark.parametrize("mesh", [BALL, CUBE, RING, CLOTH, rod(2.0, 0.1, 0.4)])
def test_a_ring_holds_all_that_is_around_a_vertex(mesh: TriangleMesh) -> None:
    live = HalfedgeMesh(mesh)
    for h in range(0, 3 * len(mesh.faces), 4):
        v, _ = ends_of(mesh, h)
        ring = ring_of(live, h)
        around = [f for f, face in enumerate(mesh.faces.tolist()) if v in face]
        assert sorted(ring.leaving[: ring.size[0]] // 3) == around
        assert set(ring.vertex[: ring.size[1]].tolist()) == set(mesh.faces[around].ravel().tolist()) - {v}
        for i in range(ring.size[0]):
            a, b, c = mesh.vertices[mesh.faces[ring.leaving[i] // 3]]
            assert np.allclose(ring.normals[i], np.cross(b - a, c - a))


def slow_distance(point: Points, triangle: Points) -> float:
    """The least over the plane, where its foot is inside, the three sides and the three corners."""
    a, b, c = triangle
    found = [float(np.linalg.norm(point - corner)) for corner in triangle]
    for one, two in ((a, b), (b, c), (c, a)):
        t = (point - one) @ (two - one) / max((two - one) @ (two - one), 1e-300)
        if 0 <= t <= 1:
            found.append(float(np.linalg.norm(point - one - t * (two - one))))
    normal = np.cross(b - a, c - a)
    if normal @ normal > 1e-24:
        foot = point - (point - a) @ normal / (normal @ normal) * normal
        inside = [np.cross(two - one, foot - one) @ normal >= 0 for one, two in ((a, b), (b, c), (c, a))]
        if all(inside):
            found.append(float(np.linalg.norm(point - foot)))
    return min(found)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([BALL, CUBE, RING]))
def test_how_far_a_vertex_is_left_behind_is_the_least_distance_from_the_new_faces(
    seed: int, mesh: TriangleMesh
) -> None:
    rng = np.random.default_rng(seed)
    moved = mesh.with_vertices(mesh.vertices + 0.2 * rng.normal(size=mesh.vertices.shape))
    live, h = HalfedgeMesh(moved), int(rng.integers(3 * len(mesh.faces)))
    a, b = ends_of(mesh, h)
    left = removal_distance(live.arrays.points, ring_of(live, h), a, b)
    new = [[b if v == a else v for v in f] for f in mesh.faces.tolist() if a in f and b not in f]
    expected = min(slow_distance(moved.vertices[a], moved.vertices[f]) for f in new)
    assert math.sqrt(max(0.0, left)) == pytest.approx(expected, abs=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_volume_swept_is_that_of_the_tetrahedra_below_the_faces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    live, h = HalfedgeMesh(BALL), int(rng.integers(3 * len(BALL.faces)))
    a, b = ends_of(BALL, h)
    told = swept_volume(live.arrays.points, a, b, ring_of(live, h))
    points = np.array(BALL.vertices)
    points[a] = points[b]
    before, after = (six_volumes(p, BALL.faces) for p in (BALL.vertices, points))
    assert told == pytest.approx(abs(after - before), abs=1e-12)


def six_volumes(points: Points, faces: AnyArray) -> float:
    a, b, c = (points[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)))


def test_of_two_soft_ends_the_one_goes_that_changes_the_volume_less() -> None:
    """On a lumpy ball midpoints would leave the surface."""
    lumps = 1 + 0.15 * np.random.default_rng(3).normal(size=(len(BALL.vertices), 1))
    mesh = BALL.with_vertices(BALL.vertices * lumps)
    live, near, far, told = HalfedgeMesh(mesh), new_ring(), new_ring(), 0
    for h in range(3 * len(mesh.faces)):
        where, _ = can_collapse(live.arrays, h, near, far, limits(cosine=-1.0, midpoints=False))
        a, b = ends_of(mesh, h)
        volumes = []
        for kept, gone in ((a, b), (b, a)):
            points = np.array(mesh.vertices)
            points[gone] = points[kept]
            volumes.append(abs(six_volumes(points, mesh.faces) - six_volumes(mesh.vertices, mesh.faces)))
        if where == NONE or abs(volumes[0] - volumes[1]) < 1e-12:
            continue
        better = AT_START if volumes[0] < volumes[1] else AT_END
        if where != better:  # only because the better one is forbidden
            forbidden = can_collapse(live.arrays, h, near, far, limits(cosine=-1.0, midpoints=True))
            assert forbidden[0] != better
        told += where == better
    assert told > 100


def test_on_a_cube_more_hard_edges_win_and_a_crease_never_crosses_a_side() -> None:
    """P30 by counting: corners have three hard edges, places on a crease two, others none."""
    live, near, far = HalfedgeMesh(CUBE), new_ring(), new_ring()
    rank = np.sum(np.abs(CUBE.vertices) == 1, axis=1) - 1  # 0 on a side, 1 on a crease, 2 at a corner
    for h in range(3 * len(CUBE.faces)):
        a, b = ends_of(CUBE, h)
        where, reason = can_collapse(live.arrays, h, near, far, limits(midpoints=False))
        one_line = np.sum((np.abs(CUBE.vertices[[a, b]]) == 1).all(axis=0)) >= 2
        if rank[a] > rank[b] and (rank[b] == 0 or one_line):
            assert where in (AT_START, NONE) and reason != FEATURE
        elif rank[a] and rank[b] and not one_line:
            assert (where, reason) == (NONE, FEATURE)


def test_the_tip_of_a_spike_is_not_let_go_where_places_are_exact() -> None:
    points = np.array(BALL.vertices)
    tip = int(np.argmax(points[:, 1]))
    points[tip] *= 1.8
    live, near, far = HalfedgeMesh(BALL.with_vertices(points)), new_ring(), new_ring()
    spokes = [h for h in range(3 * len(BALL.faces)) if ends_of(BALL, h)[0] == tip]
    exactly, halfway = (
        [can_collapse(live.arrays, h, near, far, limits(2.0, -2.0, midpoints)) for h in spokes]
        for midpoints in (False, True)
    )
    assert any(where not in (NONE, AT_START) for where, _ in halfway), "the paper's way would blunt it"
    assert all(where in (NONE, AT_START) for where, _ in exactly)
    assert any(reason == SHAPE for _, reason in exactly)


def creases_of(live: HalfedgeMesh) -> set[frozenset[tuple[float, ...]]]:
    """Tagged edges by the places of their ends."""
    return {frozenset(tuple(live.vertices[v]) for v in pair) for pair in live.tagged_edges(CREASE).tolist()}


def consistent(live: HalfedgeMesh) -> bool:
    """Both half-edges of an edge say the same, and the table is the one built anew."""
    mesh = live.snapshot()
    twins, tagged = live.twins, live.arrays.tagged[: 3 * len(mesh.faces)]
    paired = twins >= 0
    agree = np.array_equal(tagged[paired], tagged[twins[paired]])
    return bool(agree and np.array_equal(HalfedgeMesh(mesh).twins, twins))


def tagged_mesh(mesh: TriangleMesh, seed: int) -> TriangleMesh:
    """With a third of its edges tagged."""
    edges = np.unique(
        np.sort(np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1), axis=0
    )
    return mesh.with_creases(edges[np.random.default_rng(seed).random(len(edges)) < 1 / 3])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([BALL, CUBE, RING, CLOTH]))
def test_a_split_tags_both_halves_of_a_tagged_edge_and_neither_median(seed: int, mesh: TriangleMesh) -> None:
    live = HalfedgeMesh(tagged_mesh(mesh, seed))
    h = seed % (3 * len(mesh.faces))
    a, b = (tuple(mesh.vertices[v]) for v in ends_of(mesh, h))
    before, hard = creases_of(live), bool(live.arrays.tagged[h])
    live.reserve(1, 2)
    middle = int(live.sizes[0])
    live.arrays.points[middle] = np.add(a, b) / 2
    live.sizes[0] += 1
    live.sizes[1] = split_edge(live.arrays, h, middle, int(live.sizes[1]))
    expected = before
    if hard:
        place = tuple(live.vertices[middle])
        expected = before - {frozenset((a, b))} | {frozenset((a, place)), frozenset((place, b))}
    assert creases_of(live) == expected
    assert consistent(live)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([BALL, RING, CLOTH]))
def test_a_flip_leaves_the_tags_of_the_four_edges_around(seed: int, mesh: TriangleMesh) -> None:
    live = HalfedgeMesh(tagged_mesh(mesh, seed))
    soft = np.flatnonzero((live.twins >= 0) & (live.arrays.tagged[: len(live.twins)] == 0))
    h = int(soft[seed % len(soft)])
    before = creases_of(live)
    flip_edge(live.arrays, h)
    assert creases_of(live) == before
    tagged, twins = live.arrays.tagged[: len(live.twins)], live.twins
    assert np.array_equal(tagged[twins >= 0], tagged[twins[twins >= 0]])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([BALL, RING]))
def test_a_collapse_joins_the_tags_of_the_edges_that_fall_together(seed: int, mesh: TriangleMesh) -> None:
    live, near, far = HalfedgeMesh(tagged_mesh(mesh, seed)), new_ring(), new_ring()
    h = seed % (3 * len(mesh.faces))
    a, b = ends_of(mesh, h)
    if can_collapse(live.arrays, h, near, far, limits(cosine=-2.0))[0] == NONE:
        return
    before = {frozenset(pair) for pair in live.tagged_edges(CREASE).tolist()}
    expected = {frozenset(a if v == b else v for v in pair) for pair in before}
    dead = np.zeros(3, np.int32)
    collapse_edge(live.arrays, h, far, AT_START, np.array(mesh.vertices[a]), dead)
    live.compact(np.array([b], np.int32), np.sort(dead[1 : 1 + dead[0]]))
    last = len(mesh.vertices) - 1
    new_numbers = {
        frozenset(b if v == last and b != last else v for v in pair) for pair in expected if len(pair) == 2
    }
    assert {frozenset(pair) for pair in live.tagged_edges(CREASE).tolist()} == new_numbers
    assert consistent(live)
    assert validate(live.snapshot()).require(closed=True).euler == validate(mesh).require().euler


def slow_fold(live: HalfedgeMesh, v: int, place: Points, cosine: float) -> bool:
    for face in live.faces[(live.faces == v).any(axis=1)]:
        was, corners = live.vertices[face], live.vertices[face].copy()
        corners[list(face).index(v)] = place
        m, n = (np.cross(p[1] - p[0], p[2] - p[0]) for p in (was, corners))
        if m @ n < cosine * np.linalg.norm(m) * np.linalg.norm(n):
            return True
        side = max(float(np.sum((corners[i] - corners[i - 1]) ** 2)) for i in range(3))
        if n @ n < 0.02**2 * side**2 and n @ n < m @ m:
            return True
    return False


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.5), st.sampled_from([0.2, -0.5]))
def test_a_fold_is_a_face_that_turns_too_far_or_becomes_a_sliver(
    seed: int, reach: float, cosine: float
) -> None:
    rng = np.random.default_rng(seed)
    live, h = HalfedgeMesh(BALL), int(rng.integers(3 * len(BALL.faces)))
    v, _ = ends_of(BALL, h)
    place = BALL.vertices[v] + reach * rng.normal(size=3)
    assert folds(live.arrays.points, ring_of(live, h), -1, place, cosine) == slow_fold(live, v, place, cosine)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_holes_are_filled_with_the_last_ones_and_nothing_else_changes(seed: int, many: int) -> None:
    """Dead faces taken out by many collapses; what is left is the same surface, gapless."""
    rng = np.random.default_rng(seed)
    face_states = {"mark": np.arange(len(RING.vertices))}
    live = HalfedgeMesh(TriangleMesh(RING.vertices, RING.faces, face_states))
    near, far, gone, dead = new_ring(), new_ring(), [], np.zeros(1 + 2 * many, np.int32)
    for _ in range(many):
        h = int(rng.integers(3 * len(RING.faces)))
        if live.arrays.vert[h] < 0 or can_collapse(live.arrays, h, near, far, limits(cosine=-2.0))[0] == NONE:
            continue
        a, b = int(live.arrays.vert[h]), int(live.arrays.vert[h - 2 if h % 3 == 2 else h + 1])
        collapse_edge(live.arrays, h, far, AT_START, np.array(live.vertices[a]), dead)
        gone.append(b)
    names = {tuple(sorted(face)) for face in live.faces.tolist() if face[0] >= 0}
    live.compact(np.array(sorted(gone), np.int32), np.sort(dead[1 : 1 + dead[0]]))
    mesh = live.snapshot()
    kept = mesh.attributes["mark"]
    assert {tuple(sorted(face)) for face in kept[mesh.faces].tolist()} == names
    assert np.array_equal(mesh.vertices, RING.vertices[kept])
    assert consistent(live)
    stayed = [v for v in range(len(kept)) if v not in gone]
    assert np.array_equal(kept[stayed], stayed), "who need not move keeps its number"
