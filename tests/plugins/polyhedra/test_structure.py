"""Cutting and mending keep the half-edges in order, whatever is done to which polyhedron."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, validate
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import (
    OUTSIDE,
    LengthLimits,
    Polyhedron,
    PolyhedronEditor,
    between,
)
from flowsculpt.pipeline.plugins.polyhedra.subdivision import Collapser, can_collapse
from flowsculpt.pipeline.resample import Thresholds

Step = Callable[[Polyhedron, np.random.Generator], None]

KINDS = ("cube", "ell", "comb", "drum", "ring", "open box", "leaf", "tetrahedron", "ball", "cloth")
LISTS = ("next", "previous", "origin", "face", "crease", "side", "leaving", "points")


def fault_of(surface: Polyhedron) -> str | None:
    """Return the first broken invariant, or None; the invariants hold after every operation."""
    alive = [h for h in range(len(surface.origin)) if surface.origin[h] != OUTSIDE]
    for h in alive:
        after = surface.next[h]
        if surface.origin[h ^ 1] == OUTSIDE or surface.origin[after] == OUTSIDE:
            return f"half-edge {h} leads to one that was removed"
        if surface.previous[after] != h or surface.face[after] != surface.face[h]:
            return f"half-edges {h} and {after} do not follow each other"
        if surface.origin[after] != surface.origin[h ^ 1]:
            return f"half-edge {h} does not end where {after} begins"
        if surface.face[h] == OUTSIDE and surface.face[h ^ 1] == OUTSIDE:
            return f"edge {h >> 1} has no face"
    for f, h in enumerate(surface.side):
        if h != OUTSIDE and (surface.face[h] != f or len(surface.loop(h)) < 3):
            return f"face {f} has lost its sides"
    reached = [
        h
        for v in range(len(surface.leaving))
        if surface.leaving[v] != OUTSIDE
        for h in (k for k in surface.star(v) if surface.origin[k] == v)
    ]
    if sorted(reached) != alive:
        return "the fans around the vertices do not reach every half-edge once"
    ends = {(surface.origin[h], surface.origin[h ^ 1]) for h in alive}
    return None if len(ends) == len(alive) else "two edges join the same two vertices"


def split(surface: Polyhedron, rng: np.random.Generator) -> None:
    """At one to three places of a random edge."""
    h = int(rng.choice([h for h, v in enumerate(surface.origin) if v != OUTSIDE]))
    start, end = surface.points[surface.origin[h]], surface.points[surface.origin[h ^ 1]]
    count = int(rng.integers(1, 4))
    before = surface.next[h]
    made = surface.split_edge(h, [between(start, end, k / (count + 1)) for k in range(1, count + 1)])
    assert [surface.origin[k] for k in surface.loop(h)[1 : count + 2]] == [*made, surface.origin[before]]


def cut(surface: Polyhedron, rng: np.random.Generator) -> None:
    """A random face, between two of its vertices that no edge joins, where it has such."""
    f = int(rng.choice([f for f, h in enumerate(surface.side) if h != OUTSIDE]))
    loop = surface.loop(surface.side[f])
    pairs = [(h, k) for h in loop for k in loop if not _joined(surface, h, k)]
    if pairs:
        h, k = pairs[int(rng.integers(len(pairs)))]
        chord = surface.cut_face(h, k)
        assert len(surface.loop(chord)) + len(surface.loop(chord ^ 1)) == len(loop) + 2
        assert (surface.origin[chord], surface.origin[chord ^ 1]) == (surface.origin[h], surface.origin[k])


def _joined(surface: Polyhedron, h: int, k: int) -> bool:
    return h == k or surface.joined(surface.origin[h], surface.origin[k])


def collapse(surface: Polyhedron, rng: np.random.Generator) -> None:
    """A few random edges, where the guards let them."""
    mesh, _ = surface.renumber()
    editor = PolyhedronEditor(surface, LengthLimits(Thresholds(100.0), mesh))
    for _ in range(int(rng.integers(1, 6))):
        h = int(rng.choice([h for h, v in enumerate(surface.origin) if v != OUTSIDE]))
        decision = can_collapse(editor, h)
        if decision.share is not None:
            editor.collapse(h, decision.share)
            assert fault_of(surface) is None


def collapse_face(surface: Polyhedron, rng: np.random.Generator) -> None:
    """A random face, as far as the guards let it."""
    mesh, _ = surface.renumber()
    f = int(rng.integers(len(mesh)))
    size = float(np.sqrt(mesh.areas[f])) * 2
    Collapser(PolyhedronEditor(surface, LengthLimits(Thresholds(100.0, size), mesh))).faces([f], [])


@settings(max_examples=80, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**32 - 1),
    steps=st.lists(st.sampled_from([split, cut, cut, collapse, collapse, collapse_face]), max_size=25),
)
def test_no_operation_changes_the_kind_of_surface(
    kind: str, seed: int, steps: list[Step], menagerie: dict[str, PolygonMesh]
) -> None:
    rng, before = np.random.default_rng(seed), validate(menagerie[kind]).require()
    surface = Polyhedron(menagerie[kind])
    for step in steps:
        step(surface, rng)
        assert fault_of(surface) is None
    after = validate(surface.mesh()).require()
    assert (after.euler, after.closed) == (before.euler, before.closed)
    mesh, _ = surface.renumber()
    anew = Polyhedron(mesh)
    assert [getattr(surface, name) for name in LISTS] == [getattr(anew, name) for name in LISTS]


def test_half_edges_know_when_they_are_out_of_order(menagerie: dict[str, PolygonMesh]) -> None:
    for name in ("next", "previous", "origin", "face"):
        surface = Polyhedron(menagerie["cube"])
        numbers = getattr(surface, name)
        numbers[3], numbers[8] = numbers[8], numbers[3]
        assert fault_of(surface) is not None, name


def test_a_vertex_may_have_two_edges_only() -> None:
    """A side that is cut while its neighbours are small enough has such vertices."""
    points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (2, -1, 0), (0, -1, 0)]
    surface = Polyhedron(PolygonMesh(points, [(0, 1, 2, 3, 4), (2, 1, 0, 6, 5)]))
    assert fault_of(surface) is None
    assert len(surface.star(1)) == 2


def test_creases_go_along_with_splits_cuts_and_collapses() -> None:
    points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
    surface = Polyhedron(PolygonMesh(points, [(0, 1, 2, 3)], creases=[(0, 1)]))
    surface.split_edge(0, [(0.5, 0, 0), (1, 0, 0)])
    assert surface.mesh().creases.tolist() == [[0, 4], [1, 5], [4, 5]]
    chord = surface.cut_face(surface.leaving[5], surface.leaving[3])
    assert not surface.crease[chord >> 1]
    surface.collapse_edge(0, (0.25, 0.0, 0.0))
    assert surface.renumber()[0].creases.tolist() == [[0, 4], [1, 4]]
    assert fault_of(surface) is None


@pytest.mark.parametrize(
    ("faces", "fault"),
    [
        ([(0, 1, 2, 3), (0, 1, 4)], "the same way"),
        ([(0, 1, 2), (1, 0, 3), (0, 1, 4)], "3 faces"),
        ([(0, 1, 2, 3, 1, 4)], "names vertex 1 twice"),
        ([(0, 1, 2), (0, 3, 4)], "joins two parts of the surface"),
        ([(0, 1, 2, 3, 4), (4, 3, 2, 1, 0)], "on its back"),
        ([(0, 1, 2, 3)], "belongs to no face"),
    ],
)
def test_what_is_no_surface_is_refused_with_its_fault(faces: list[tuple[int, ...]], fault: str) -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    with pytest.raises(MeshError, match=fault):
        Polyhedron(PolygonMesh(points, faces))
