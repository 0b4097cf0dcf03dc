"""The corner table against a slow twin, and what it promises about room, holes and attributes."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, box, icosphere, sheet, torus
from flowsculpt.pipeline.mesh.kernels.halfedge import CROWDED, DISAGREEING, SOUND, match_twins

MENAGERIE = [box(edge_length=0.7), icosphere(3), sheet(edge_length=0.5), torus(1, 0.4, 0.3)]


def slow_twins(mesh: TriangleMesh) -> list[int]:
    """By a dictionary from directed edges to half-edges."""
    ends = [(int(f[i]), int(f[(i + 1) % 3])) for f in mesh.faces for i in range(3)]
    at = {edge: h for h, edge in enumerate(ends)}
    return [at.get((b, a), -1) for a, b in ends]


@pytest.mark.parametrize("mesh", MENAGERIE)
def test_twins_are_those_a_dictionary_finds(mesh: TriangleMesh) -> None:
    assert HalfedgeMesh(mesh).twins.tolist() == slow_twins(mesh)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(MENAGERIE), st.randoms(use_true_random=False))
def test_twins_do_not_care_how_faces_are_ordered(mesh: TriangleMesh, random: object) -> None:
    rng = np.random.default_rng(random.getrandbits(32))  # type: ignore[attr-defined]
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    faces = np.stack([np.roll(f, k) for f, k in zip(faces, rng.integers(3, size=len(faces)), strict=True)])
    shuffled = TriangleMesh(mesh.vertices, faces)
    assert HalfedgeMesh(shuffled).twins.tolist() == slow_twins(shuffled)


@settings(deadline=None)
@given(st.lists(st.permutations(range(6)).map(lambda row: tuple(row[:3])), min_size=1, max_size=8))
def test_of_any_faces_the_matching_tells_what_is_wrong_and_where(faces: list[tuple[int, ...]]) -> None:
    mesh = TriangleMesh(np.zeros((6, 3)), faces)
    twin = np.empty(mesh.faces.size, np.int32)
    ends = [(f[i], f[(i + 1) % 3]) for f in faces for i in range(3)]
    around = Counter(frozenset(edge) for edge in ends)
    fault, h = match_twins(mesh.faces.reshape(-1), 6, twin)
    if max(around.values()) <= 2 and max(Counter(ends).values()) == 1:
        assert (fault, twin.tolist()) == (SOUND, slow_twins(mesh))
    elif fault == CROWDED:
        assert around[frozenset(ends[h])] > 2
    else:
        assert fault == DISAGREEING
        assert around[frozenset(ends[h])] == ends.count(ends[h]) == 2


def test_room_grows_and_keeps_what_is_there() -> None:
    mesh = icosphere(3)
    live = HalfedgeMesh(mesh)
    live.reserve(10_000, 20_000)
    assert len(live.arrays.points) >= 10_000 + len(mesh.vertices)
    assert np.array_equal(live.vertices, mesh.vertices)
    assert np.array_equal(live.faces, mesh.faces)
    assert live.twins.tolist() == slow_twins(mesh)


def test_vertices_are_a_live_view() -> None:
    live = HalfedgeMesh(box())
    live.vertices[:] *= 3
    assert np.allclose(live.snapshot().vertices, 3 * box().vertices)


def test_attributes_keep_their_shape_and_type() -> None:
    ball = icosphere(2)
    n = len(ball.vertices)
    given_ = {
        "rest": ball.vertices,
        "weight": np.arange(n, dtype=np.float32),
        "material": np.arange(n, dtype=np.int16),
        "pinned": np.arange(n) % 2 == 0,
        "frame": np.arange(4.0 * n).reshape(n, 2, 2),
    }
    back = HalfedgeMesh(TriangleMesh(ball.vertices, ball.faces, given_)).snapshot().attributes
    assert list(back) == list(given_)
    for name, values in given_.items():
        assert back[name].dtype == values.dtype
        assert np.array_equal(back[name], values)


def test_attributes_that_cannot_be_carried_are_refused() -> None:
    cube = box()
    with pytest.raises(MeshError, match="'name' holds"):
        HalfedgeMesh(TriangleMesh(cube.vertices, cube.faces, {"name": np.array(["a"] * 8)}))
    with pytest.raises(MeshError, match="not finite"):
        HalfedgeMesh(TriangleMesh(cube.vertices, cube.faces, {"heat": np.full(8, np.nan)}))


def test_a_mesh_that_is_not_sound_is_refused() -> None:
    with pytest.raises(MeshError, match="no faces"):
        HalfedgeMesh(TriangleMesh(np.eye(3), []))
