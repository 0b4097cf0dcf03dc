"""The kernels against slow twins that say the same in sets and loops."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import (
    HalfedgeMesh,
    TriangleMesh,
    box,
    dihedral_angles,
    icosphere,
    rod,
    sheet,
    torus,
)
from flowsculpt.pipeline.resample import Thresholds, resample
from flowsculpt.pipeline.resample.kernels.collapse import BOUNDARY, CROWDED, LINK, can_collapse
from flowsculpt.pipeline.resample.kernels.flip import flip_edge, should_flip
from flowsculpt.pipeline.resample.kernels.pass_state import MAX_SPOKES, Limits, new_ring

TUBE = rod(2.0, 0.1, 0.4)
MENAGERIE = [
    icosphere(1), icosphere(3), box(), box(edge_length=1.0), TUBE, torus(1.0, 0.1, 0.5),
    sheet(edge_length=1.0), sheet((1, 4), 1.0), TriangleMesh(np.eye(3), [(0, 1, 2)]),
    TriangleMesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]),
]  # fmt: skip
Complex = set[frozenset[int]]


def cut(face: tuple[int, ...]) -> Complex:
    """A face, its edges and its corners."""
    corners = frozenset(face)
    return {corners, *(corners - {v} for v in corners), *(frozenset({v}) for v in corners)}


def link(complex_: Complex, simplex: frozenset[int]) -> Complex:
    return {s - simplex for s in complex_ if simplex < s}


def may_collapse(mesh: TriangleMesh, a: int, b: int) -> bool:
    """Dey, Edelsbrunner, Guha & Nekhayev (1999): Lk a ∩ Lk b = Lk ab, boundaries closed by a cone from -1."""
    faces = [tuple(int(v) for v in f) for f in mesh.faces]
    directed = {(f[i], f[(i + 1) % 3]) for f in faces for i in range(3)}
    cone = [(x, y, -1) for x, y in directed if (y, x) not in directed]
    complex_ = set().union(*(cut(f) for f in [*faces, *cone]))
    return link(complex_, frozenset({a})) & link(complex_, frozenset({b})) == link(
        complex_, frozenset({a, b})
    )


@pytest.mark.slow
@pytest.mark.parametrize("mesh", MENAGERIE)
def test_the_link_condition_is_the_one_of_the_books(mesh: TriangleMesh) -> None:
    live, limits = HalfedgeMesh(mesh), Limits(math.inf, math.inf, -2.0)
    near, far = new_ring(), new_ring()
    for h in range(3 * len(mesh.faces)):
        a, b = (int(mesh.faces[h // 3, (h + i) % 3]) for i in (0, 1))
        _, reason = can_collapse(live.arrays, h, near, far, limits)
        assert (reason not in (LINK, BOUNDARY)) == may_collapse(mesh, a, b), (a, b)


@pytest.mark.parametrize("mesh", MENAGERIE)
def test_dihedral_angles_are_those_of_a_loop_over_edges(mesh: TriangleMesh) -> None:
    normal = {}
    for f, (a, b, c) in enumerate(mesh.vertices[mesh.faces]):
        n = np.cross(b - a, c - a)
        normal[f] = n / np.linalg.norm(n)
    owner = {(int(f[i]), int(f[(i + 1) % 3])): k for k, f in enumerate(mesh.faces) for i in range(3)}
    angles = dihedral_angles(mesh)
    for (a, b), f in owner.items():
        h = 3 * f + [int(v) for v in mesh.faces[f]].index(a)
        if (b, a) not in owner:
            assert math.isnan(angles[h])
        else:
            cosine = float(np.clip(normal[f] @ normal[owner[b, a]], -1, 1))
            assert angles[h] == pytest.approx(math.acos(cosine), abs=1e-6)


def soup(mesh: TriangleMesh) -> set[tuple[tuple[float, ...], ...]]:
    """The triangles as rounded points, each begun at its least corner: equal for equal surfaces."""
    triangles = set()
    for triangle in mesh.vertices[mesh.faces].round(9) + 0.0:
        corners = [tuple(float(x) for x in p) for p in triangle]
        least = corners.index(min(corners))
        triangles.add(tuple(corners[least:] + corners[:least]))
    return triangles


def slow_split(mesh: TriangleMesh, a: int, b: int) -> TriangleMesh:
    """Every face that has the edge is written twice, with the midpoint in place of either end."""
    middle = len(mesh.vertices)
    faces = []
    for f in mesh.faces.tolist():
        both = a in f and b in f
        faces += [[middle if v == end else v for v in f] for end in (a, b)] if both else [f]
    return TriangleMesh([*mesh.vertices, (mesh.vertices[a] + mesh.vertices[b]) / 2], faces)


def slow_collapse(mesh: TriangleMesh, a: int, b: int) -> TriangleMesh:
    """b becomes a, a moves to the midpoint, and faces with a corner twice go."""
    points = np.array(mesh.vertices)
    points[a] = (points[a] + points[b]) / 2
    faces = [[a if v == b else v for v in f] for f in mesh.faces.tolist()]
    return TriangleMesh(points, [f for f in faces if len(set(f)) == 3])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 3 * 180 - 1))
def test_one_split_is_that_of_the_slow_twin(h: int) -> None:
    ball = icosphere(3)
    a, b = (int(ball.faces[h // 3, (h + i) % 3]) for i in (0, 1))
    points = np.array(ball.vertices)
    points[a] *= 1.6
    points[b] *= 1.6
    points[a] += 0.3 * (points[a] - points[b])
    stretched = ball.with_vertices(points)
    ends = stretched.vertices[stretched.faces]
    lengths = np.sort(np.unique(np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).round(12)))
    longest = float(np.linalg.norm(points[a] - points[b]))
    if lengths[-1] > longest + 1e-9 or lengths[-1] - lengths[-2] < 1e-6:
        return  # another edge is as long: not a test of one split
    done, report = resample(stretched, Thresholds(float(lengths[-2:].mean()), 0.0))
    expected = slow_split(stretched, a, b)
    assert report.splits == 1
    if report.flips == 0:
        assert soup(done) == soup(expected)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 3 * 180 - 1))
def test_one_collapse_is_that_of_the_slow_twin(h: int) -> None:
    ball = icosphere(3)
    a, b = (int(ball.faces[h // 3, (h + i) % 3]) for i in (0, 1))
    points = np.array(ball.vertices)
    middle = (points[a] + points[b]) / 2
    points[[a, b]] = middle + 0.3 * (points[[a, b]] - middle)
    pinched = ball.with_vertices(points)
    done, report = resample(pinched, Thresholds(2.0, 0.2, hard_angle=math.pi))
    assert report.collapses == 1
    if report.flips == 0:
        assert soup(done) == soup(slow_collapse(pinched, a, b))


def test_a_flip_turns_one_edge_and_a_second_flip_turns_it_back() -> None:
    mesh = sheet((2, 2), 0.5)
    checked = 0
    for h in np.flatnonzero(HalfedgeMesh(mesh).twins >= 0):
        live = HalfedgeMesh(mesh)
        flip_edge(live.arrays, int(h))
        edges = {tuple(sorted(pair)) for f in live.faces.tolist() for pair in pairwise([*f, f[0]])}
        if len(edges) == live.edges:
            assert np.array_equal(HalfedgeMesh(live.snapshot()).twins, live.twins)
            checked += 1
        flip_edge(live.arrays, int(h - 2 if h % 3 == 2 else h + 1))
        assert soup(live.snapshot()) == soup(mesh)
    assert checked > 50


def test_flips_leave_creases_and_good_edges_alone() -> None:
    """The long diagonal of a flat kite is turned; folded along it, it is a crease and stays."""
    limits = Limits(3.0, 0.0, math.cos(math.radians(40)))
    kite = [(-1, 0, 0), (1, 0, 0), (0, 0.3, 0), (0, -0.3, 0)]
    faces = [(0, 1, 2), (1, 0, 3)]
    flat = HalfedgeMesh(TriangleMesh(kite, faces))
    folded = HalfedgeMesh(TriangleMesh([*kite[:2], (0, 0.2, 0.25), (0, -0.2, 0.25)], faces))
    good = HalfedgeMesh(TriangleMesh([(-0.3, 0, 0), (0.3, 0, 0), (0, 1, 0), (0, -1, 0)], faces))
    assert should_flip(flat.arrays, 0, limits)
    assert not should_flip(folded.arrays, 0, limits)
    assert not should_flip(good.arrays, 0, limits)
    assert not should_flip(flat.arrays, 0, Limits(math.sqrt(0.2), 0.0, 0.7)), "the new edge would be too long"


@pytest.mark.parametrize("height", [0.002, 0.2])
def test_where_edges_may_not_bend_the_diagonal_that_bends_less_wins(height: float) -> None:
    """A square on a cylinder: angles leave its diagonal across the bend, its height over the cylinder not."""
    corners = [(-0.2, -0.02, 0), (0.2, -0.02, 0), (0, 0, -0.2), (0, 0, 0.2)]
    normals = np.array([(-0.2, 1, 0), (0.2, 1, 0), (0, 1, 0), (0, 1, 0)]) / (8 * height)
    for faces, bends_most in (([(0, 1, 2), (1, 0, 3)], True), ([(2, 3, 0), (3, 2, 1)], False)):
        live = HalfedgeMesh(TriangleMesh(corners, faces))
        column = live.set_fields(np.column_stack([np.tile([1.0, 0.0, -2.0], (4, 1)), normals]))
        limits = Limits(1.0, 0.0, 0.7, field_column=column)
        assert not should_flip(live.arrays, 0, limits)
        bends_much = bends_most and height < 0.01
        assert should_flip(live.arrays, 0, limits._replace(bends=True)) == bends_much


def test_an_end_with_too_many_neighbours_is_left_alone() -> None:
    turn = 2 * math.pi * np.arange(MAX_SPOKES + 1) / (MAX_SPOKES + 1)
    rim = np.column_stack([np.cos(turn), 0 * turn, -np.sin(turn)])
    n = len(rim)
    faces = [(i, (i + 1) % n, n) for i in range(n)] + [((i + 1) % n, i, n + 1) for i in range(n)]
    top = TriangleMesh([*rim, (0, 1, 0), (0, -1, 0)], faces)
    limits = Limits(math.inf, math.inf, -2.0)
    assert can_collapse(HalfedgeMesh(top).arrays, 1, new_ring(), new_ring(), limits)[1] == CROWDED
    assert can_collapse(HalfedgeMesh(top).arrays, 0, new_ring(), new_ring(), limits)[1] != CROWDED
