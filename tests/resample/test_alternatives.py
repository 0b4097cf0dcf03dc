"""Ways to split that the paper compares itself with (P26): faces into four."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, sheet, torus, validate
from flowsculpt.pipeline.resample import (
    Curved,
    Exact,
    Resampler,
    ThresholdFormula,
    Thresholds,
    edges_by_angle,
    resample,
)
from flowsculpt.pipeline.resample.resampler import quadrisect

TRIANGLE = TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])

subjects = st.sampled_from(
    [box(), box((1.0, 2.0, 3.0), 0.5), icosphere(3), torus(1.0, 0.4, 0.5), sheet((2.0, 1.0), 0.4), TRIANGLE]
)
stretches = st.tuples(*[st.floats(0.2, 4.0)] * 3)


def edge_lengths(mesh: TriangleMesh) -> Floats:
    corners = mesh.vertices[mesh.faces]
    lengths: Floats = np.linalg.norm(corners - corners[:, (1, 2, 0)], axis=2)
    return lengths


def area(mesh: TriangleMesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume(mesh: TriangleMesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_a_triangle_with_one_long_side_becomes_four() -> None:
    mesh = quadrisect(TRIANGLE, Thresholds(1.2)).mesh
    assert mesh.vertices[3:].tolist() == [[0.5, 0, 0], [0, 0.5, 0], [0.5, 0.5, 0]]
    assert mesh.faces.tolist() == [[0, 3, 4], [3, 1, 5], [4, 5, 2], [3, 5, 4]]


def test_a_neighbour_of_a_face_that_is_cut_becomes_two_so_that_the_surface_conforms() -> None:
    points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.8, 0.0], [0.5, -1.5, 0.0]]
    after = quadrisect(TriangleMesh(points, [[0, 1, 2], [0, 3, 1]]), Thresholds(1.2))
    assert after.passes == 1 and validate(after.mesh).sound
    assert after.mesh.faces[:2].tolist() == [[0, 4, 2], [4, 1, 2]] and len(after.mesh.faces) == 2 + 4


@pytest.mark.parametrize("turn", range(3))
def test_a_face_between_two_that_are_cut_becomes_three(turn: int) -> None:
    """The piece with four corners is cut along its shorter diagonal."""
    points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.5, 0.0], [0.5, -1.4, 0.0], [2.2, 1.2, 0.0]]
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 4, 2]])
    mesh = TriangleMesh(points, np.roll(faces, turn, axis=1))
    after = quadrisect(mesh, Thresholds(1.3)).mesh
    assert len(after.faces) == 3 + 4 + 4 and validate(after).sound
    assert area(after) == pytest.approx(area(mesh), rel=1e-14)
    first, across = np.array([0.0, 0.0, 0.0]), np.array([0.8, 0.25, 0.0])
    second, other = np.array([0.5, 0.0, 0.0]), np.array([0.6, 0.5, 0.0])
    shorter = min((first, across), (second, other), key=lambda ends: np.linalg.norm(ends[0] - ends[1]))
    ends = {tuple(np.round(point, 12)) for point in shorter}
    edges = [after.vertices[[face[i], face[i - 1]]] for face in after.faces for i in range(3)]
    assert any({tuple(np.round(point, 12)) for point in edge} == ends for edge in edges)


@pytest.mark.slow
@given(subjects, stretches, st.floats(0.15, 1.0))
@settings(deadline=None, max_examples=60)
def test_cutting_faces_leaves_the_surface_where_it_was(
    subject: TriangleMesh, stretch: tuple[float, float, float], longest: float
) -> None:
    before = subject.with_vertices(subject.vertices * stretch)
    after = quadrisect(before, Thresholds(longest)).mesh
    assert edge_lengths(after).max() <= longest * (1 + 1e-12)
    sound, was = validate(after), validate(before)
    assert sound.problem is None and sound.euler == was.euler and sound.closed == was.closed
    assert area(after) == pytest.approx(area(before), rel=1e-9)
    assert volume(after) == pytest.approx(volume(before), rel=1e-9, abs=1e-9)
    np.testing.assert_array_equal(after.vertices[: len(before.vertices)], before.vertices)


@given(subjects, st.floats(0.1, 0.8))
@settings(deadline=None, max_examples=30)
def test_attributes_and_creases_go_along(subject: TriangleMesh, longest: float) -> None:
    x, y, z = subject.vertices.T
    named = {
        "heat": (1 + x + 2 * y - z).astype(np.float32),
        "place": subject.vertices,
        "part": np.arange(len(x), dtype=np.int16) % 5,
        "kept": x > 0.1,
    }
    creases = edges_by_angle(subject, np.radians(40.0))
    before = TriangleMesh(subject.vertices, subject.faces, named, creases)
    after = quadrisect(before, Thresholds(longest)).mesh
    np.testing.assert_array_equal(after.attributes["place"], after.vertices)
    x, y, z = after.vertices.T
    np.testing.assert_allclose(after.attributes["heat"], 1 + x + 2 * y - z, atol=1e-5)
    assert after.attributes["heat"].dtype == np.float32
    assert after.attributes["part"].dtype == np.int16 and after.attributes["kept"].dtype == bool
    assert set(after.attributes["part"]) <= set(before.attributes["part"])

    def crease_length(mesh: TriangleMesh) -> float:
        return float(np.linalg.norm(np.diff(mesh.vertices[mesh.creases], axis=1), axis=2).sum())

    assert crease_length(after) == pytest.approx(crease_length(before), rel=1e-12)
    Resampler(after, Thresholds(longest))  # refuses creases that are no edges


def test_a_surface_without_long_edges_is_the_same_mesh() -> None:
    mesh = icosphere(4)
    assert quadrisect(mesh, Thresholds(2.0)).mesh is mesh


def test_functions_say_where_faces_are_cut() -> None:
    thresholds = Thresholds(ThresholdFormula("0.05 + 0.1 * abs(x)"))
    mesh, report = resample(sheet((4.0, 1.0), 0.5), thresholds, splits="faces")
    a, b = mesh.vertices[mesh.faces], mesh.vertices[np.roll(mesh.faces, -1, axis=1)]
    allowed = 0.05 + 0.1 * np.maximum(np.abs(a[..., 0]), np.abs(b[..., 0]))
    lengths = np.linalg.norm(a - b, axis=2)
    assert report.too_long == 0 and (lengths <= allowed * (1 + 1e-12)).all()
    x = np.abs(mesh.vertices[:, 0])
    assert (x < 0.5).sum() > 2 * (x > 1.5).sum() > 20


def test_a_frame_of_faces_counts_its_splits() -> None:
    ball = icosphere(4)
    after, report = resample(ball, Thresholds(0.2, 0.0), splits="faces")
    assert report.splits == len(after.vertices) - len(ball.vertices) > 400
    assert report.too_long == 0 and report.passes == 1
    still, done = resample(after, Thresholds(0.5, 0.0), splits="faces")
    assert done.splits == 0 and done.passes == 0
    np.testing.assert_array_equal(still.vertices, after.vertices)


def flow(points: Floats, frame: int) -> Floats:
    x, y, z = points.T
    return np.column_stack([x + 0.06 * np.sin(2 * y + frame), y + 0.05 * np.sin(3 * z), 1.02 * z])


def run(resampler: Resampler, frames: range) -> list[int]:
    splits = []
    for frame in frames:
        resampler.vertices[:] = flow(resampler.vertices, frame)
        splits.append(resampler.resample().splits)
    return splits


def begin(splits: str) -> Resampler:
    ball = icosphere(8)
    named = {"part": np.arange(len(ball.vertices)) % 3, "heat": ball.vertices[:, 0]}
    mesh = TriangleMesh(ball.vertices, ball.faces, named, ball.faces[:4, :2])
    return Resampler(mesh, Thresholds(0.2), splits=splits)  # type: ignore[arg-type]


def test_a_film_of_faces_goes_on_with_the_same_bits() -> None:
    through, stopped = begin("faces"), begin("faces")
    assert sum(run(through, range(16))) > 100
    run(stopped, range(7))
    resumed = Resampler.from_state(stopped.state(), Thresholds(0.2), splits="faces")
    run(resumed, range(7, 16))
    one, other = through.state(), resumed.state()
    assert one.keys() == other.keys()
    assert all(one[name].tobytes() == other[name].tobytes() for name in one)


def test_edges_need_fewer_splits_than_faces() -> None:
    """P26: what the paper holds against them; collapses take back what is more than needed."""
    counts = {}
    for splits in ("edges", "faces"):
        resampler = begin(splits)
        counts[splits] = sum(run(resampler, range(24)))
        mesh = resampler.mesh
        assert validate(mesh).closed and edge_lengths(mesh).max() <= 0.2 * (1 + 1e-12)
    assert counts["faces"] > 1.5 * counts["edges"]


def test_a_surface_that_outgrows_its_budget_stays_as_it_was() -> None:
    resampler = Resampler(icosphere(4), Thresholds(0.05, max_vertices=500), splits="faces")
    before = resampler.mesh
    with pytest.raises(FrameError, match=r"162 vertices and 480 edges to split exceed the budget of 500"):
        resampler.resample()
    np.testing.assert_array_equal(resampler.mesh.faces, before.faces)


def test_a_vertex_that_is_not_finite_is_named() -> None:
    resampler = begin("faces")
    resampler.vertices[7] = np.inf
    with pytest.raises(FrameError, match=r"vertex 7 is at .*not finite"):
        resampler.resample()


@pytest.mark.parametrize("placement", [Curved(), Exact(lambda points: points)], ids=["curved", "exact"])
def test_faces_are_cut_on_the_chord_only(placement: Curved | Exact) -> None:
    name = type(placement).__name__
    with pytest.raises(UsageError, match=re.escape(f"and {name} elsewhere; use Chord(), or split edges")):
        Resampler(icosphere(2), Thresholds(1.0), placement, splits="faces")
    with pytest.raises(UsageError, match="splits 'corners' is not known"):
        Resampler(icosphere(2), Thresholds(1.0), splits="corners")  # type: ignore[arg-type]
