"""Positions of new vertices, against twins in plain numpy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray, Indices, Points, Vectors
from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, box, icosphere, sheet, torus
from flowsculpt.pipeline.resample.kernels.pass_state import Changes, Limits, new_ring
from flowsculpt.pipeline.resample.kernels.split import (
    BIRTH_HALFEDGE,
    BIRTH_SIZE,
    Midpoints,
    classify_around,
    curved_midpoints,
    incoming,
    place_vertices,
    side_normal,
    split_edges,
)
from flowsculpt.pipeline.resample.resample_pass import changes_of, reset

HARD = math.cos(math.radians(40))
CUBE, BALL, RING = box(edge_length=0.5), icosphere(4), torus(1.0, 0.4, 0.3)


def limits(longest: float = math.inf, shortest: float = 0.0) -> Limits:
    return Limits(longest, shortest, HARD)


def work_list(room: int) -> Indices:
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def nothing_changed(live: HalfedgeMesh) -> Changes:
    """Return the record of a pass that has changed nothing yet."""
    changes = changes_of(live)
    reset(changes)
    return changes


def cut(mesh: TriangleMesh, longest: float) -> tuple[HalfedgeMesh, Indices]:
    """One pass of splits: the surface with its new vertices on their chords, and the births (N, BIRTH)."""
    live = HalfedgeMesh(mesh)
    ends = live.vertices[live.faces]
    lengths = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).reshape(-1)
    first = np.flatnonzero((lengths > longest) & (live.twins < np.arange(len(lengths))))
    live.reserve(len(first), 2 * len(first))
    remaining, births = work_list(50 * len(first)), work_list(BIRTH_SIZE * len(first))
    changes, order = nothing_changed(live), first.astype(np.int32)
    split_edges(live.arrays, live.sizes, limits(longest), order, remaining, births, changes)
    return live, births[1 : 1 + births[0]].reshape(-1, BIRTH_SIZE)


def face_normals(points: Points, faces: AnyArray) -> Vectors:
    a, b, c = (points[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def slow_side_normal(mesh: TriangleMesh, vertex: int, face: int, creases: set[frozenset[int]]) -> Points:
    """Flood over the faces of a vertex from one of them, never across a crease; each weighs its angle."""
    around = [f for f, corners in enumerate(mesh.faces.tolist()) if vertex in corners]
    reached, waiting = {face}, [face]
    while waiting:
        here = set(mesh.faces[waiting.pop()].tolist())
        for f in around:
            shared = here & set(mesh.faces[f].tolist())
            if f not in reached and len(shared) == 2 and frozenset(shared) not in creases:
                reached.add(f)
                waiting.append(f)
    total = np.zeros(3)
    for f in reached:
        one, two = (mesh.vertices[v] - mesh.vertices[vertex] for v in mesh.faces[f] if v != vertex)
        cosine = one @ two / np.linalg.norm(one) / np.linalg.norm(two)
        total += math.acos(np.clip(cosine, -1, 1)) * face_normals(mesh.vertices, mesh.faces[[f]])[0]
    return total / np.linalg.norm(total)


def hard_edges(mesh: TriangleMesh, cosine: float) -> set[frozenset[int]]:
    """Pairs of faces that share two corners and turn by more than the angle, and sides of one face only."""
    normals, owner = face_normals(mesh.vertices, mesh.faces), {}
    for f, corners in enumerate(mesh.faces.tolist()):
        for i in range(3):
            owner.setdefault(frozenset((corners[i], corners[(i + 1) % 3])), []).append(f)
    return {e for e, fs in owner.items() if len(fs) == 1 or normals[fs[0]] @ normals[fs[1]] < cosine}


@pytest.mark.parametrize("mesh", [CUBE, BALL, RING, sheet((2, 2), 0.5)])
def test_the_normal_of_a_side_is_that_of_a_flood_up_to_the_creases(mesh: TriangleMesh) -> None:
    live, creases = HalfedgeMesh(mesh), hard_edges(mesh, HARD)
    out = np.empty(3)
    for h in range(0, 3 * len(mesh.faces), 5):
        f, i = divmod(h, 3)
        a, b = int(mesh.faces[f, i]), int(mesh.faces[f, (i + 1) % 3])
        if frozenset((a, b)) in creases:
            continue
        side_normal(live.arrays, h, HARD, out, 0)
        assert np.allclose(out, slow_side_normal(mesh, a, f, creases), atol=1e-9)


@pytest.mark.parametrize("mesh", [CUBE, BALL, RING, sheet((2, 2), 0.5)])
def test_the_births_of_a_pass_name_the_half_edges_of_their_own_edge(mesh: TriangleMesh) -> None:
    live, births = cut(mesh, 0.3)
    vert, first = live.arrays.vert, len(mesh.vertices)
    for i, (a, b, leaving) in enumerate(births.tolist()):
        into = incoming(live.arrays, leaving, a)
        after = into - 2 if into % 3 == 2 else into + 1
        onward = leaving - 2 if leaving % 3 == 2 else leaving + 1
        assert (vert[into], vert[after]) == (a, first + i)
        assert (vert[leaving], vert[onward]) == (first + i, b)


def middles(mesh: TriangleMesh, longest: float) -> tuple[Points, Vectors, Points]:
    live, births = cut(mesh, longest)
    places, normals = np.empty((len(births), 3)), np.empty((len(births), 3))
    curved_midpoints(live.arrays, births, HARD, Midpoints(places, normals, np.empty(7)))
    chords = mesh.vertices[births[:, :2]].mean(axis=1)
    return places, normals, chords


def test_on_a_ball_curved_middles_are_the_cubic_of_the_two_normals() -> None:
    """Curved PN triangles: the border curve at one half is the chord's middle less an eighth of the rises."""
    ball, longest = BALL, 0.33
    live, births = cut(ball, longest)
    places, normals, chords = middles(ball, longest)
    surface = live.snapshot()
    creases: set[frozenset[int]] = set()
    for i in range(0, len(births), 7):
        a, b, leaving = births[i].tolist()
        one = slow_side_normal(surface, a, incoming(live.arrays, leaving, a) // 3, creases)
        two = slow_side_normal(surface, b, leaving // 3, creases)
        along = ball.vertices[b] - ball.vertices[a]
        expected = chords[i] - ((along @ one) * one - (along @ two) * two) / 8
        assert np.allclose(places[i], expected, atol=1e-9)
        assert np.allclose(normals[i], (one + two) / np.linalg.norm(one + two), atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(-1.0, 1.0))
def test_flat_sides_straight_creases_and_corners_stay_what_they_are(stretch: float, shear: float) -> None:
    points = CUBE.vertices * (stretch, 1.0, 1.0)
    points[:, 0] += shear * points[:, 1]
    places, normals, chords = middles(CUBE.with_vertices(points), 0.4)
    assert np.allclose(places, chords, atol=1e-12)
    soft = np.linalg.norm(normals, axis=1) > 0.5
    assert 0 < np.count_nonzero(~soft) < len(soft), "middles of creases have no normal"


def test_a_round_crease_is_bent_along_and_the_corner_of_a_cube_is_not() -> None:
    """A drum of 24 sides: its rims are circles, which a cubic through two points meets to a millionth."""
    turn = 2 * math.pi * np.arange(24) / 24
    rim = np.column_stack([np.cos(turn), 0 * turn, -np.sin(turn)])
    n = len(rim)
    walls = [(i, (i + 1) % n, n + i) for i in range(n)] + [
        ((i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)
    ]
    lids = [(2 * n, (i + 1) % n, i) for i in range(n)] + [
        (2 * n + 1, n + i, n + (i + 1) % n) for i in range(n)
    ]
    half = np.array([0, 0.1, 0])
    drum = TriangleMesh([*(rim - half), *(rim + half), -half, half], walls + lids)
    places, normals, chords = middles(drum, 0.25)
    on_rim = (np.linalg.norm(normals, axis=1) == 0) & (np.linalg.norm(chords[:, ::2], axis=1) > 0.95)
    assert np.count_nonzero(on_rim) >= n, "others wait for the next pass"
    off = np.abs(np.linalg.norm(places[on_rim][:, ::2], axis=1) - 1)
    chord_off = np.abs(np.linalg.norm(chords[on_rim][:, ::2], axis=1) - 1)
    assert off.max() < 0.01 * chord_off.max()


def slow_folds(live: HalfedgeMesh, vertex: int, place: Points) -> bool:
    """Tell whether a face at the vertex would turn by more than 120 degrees, or become a worse sliver."""
    around = live.faces[(live.faces == vertex).any(axis=1)]
    after = live.vertices.copy()
    after[vertex] = place
    for face in around:
        was, now = (
            np.cross(p[face[1]] - p[face[0]], p[face[2]] - p[face[0]]) for p in (live.vertices, after)
        )
        corners = after[face]
        side = max(float(np.sum((corners[i] - corners[i - 1]) ** 2)) for i in range(3))
        if was @ now < -0.5 * np.linalg.norm(was) * np.linalg.norm(now):
            return True
        if now @ now < 0.02**2 * side**2 and now @ now < was @ was:
            return True
    return False


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.0))
def test_settling_moves_all_that_does_not_fold_and_nothing_that_does(seed: int, reach: float) -> None:
    live, births = cut(BALL, 0.36)
    last, first = int(live.sizes[0]), len(BALL.vertices)
    rng = np.random.default_rng(seed)
    places = live.vertices[first:last] + reach * rng.normal(size=(last - first, 3))
    before, went = live.vertices.copy(), np.zeros(last - first, np.uint8)
    spokes = np.ascontiguousarray(births[:, BIRTH_HALFEDGE])
    done = place_vertices(live.arrays, spokes, new_ring(), places, places, limits(0.36), went)
    assert done == np.count_nonzero(went)
    assert np.array_equal(live.vertices[first:][went > 0], places[went > 0])
    assert np.array_equal(live.vertices[first:][went == 0], before[first:][went == 0])
    assert np.array_equal(live.vertices[:first], before[:first])
    if done == len(went) or not done:
        return
    for i in np.flatnonzero(went == 0)[:5]:
        assert slow_folds(live, first + int(i), places[i]), "what is left behind would still fold"


@pytest.mark.parametrize("mesh", [BALL, sheet((2, 2), 0.5)])
def test_after_a_move_all_long_edges_around_are_listed_once(mesh: TriangleMesh) -> None:
    live, births = cut(mesh, 0.33)
    first = len(mesh.vertices)
    live.vertices[first:] += 0.1 * np.random.default_rng(1).normal(size=(len(births), 3))
    long_edges = work_list(30 * len(births))
    classify_around(live.arrays, births, limits(0.3), work_list(0), long_edges, nothing_changed(live))
    found = long_edges[1 : 1 + long_edges[0]]
    after = np.where(found % 3 == 2, found - 2, found + 1)
    ends = live.arrays.vert[np.column_stack([found, after])]
    listed = {frozenset(pair) for pair in ends.tolist()}
    expected = set()
    for face in live.faces.tolist():
        for i in range(3):
            a, b = face[i], face[(i + 1) % 3]
            if max(a, b) >= first and np.linalg.norm(live.vertices[a] - live.vertices[b]) > 0.3:
                expected.add(frozenset((a, b)))
    assert listed == expected
