"""Large surfaces are kept in an order of space; nothing but the numbers of vertices and faces changes."""

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, icosphere, validate
from flowsculpt.pipeline.mesh.halfedge_mesh import with_identities
from flowsculpt.pipeline.resample import Resampler, Thresholds
from flowsculpt.pipeline.resample.resampler import in_memory_order

LARGE = icosphere(56)


def shuffled(mesh: TriangleMesh) -> TriangleMesh:
    order = np.random.default_rng(7).permutation(len(mesh.faces))
    return TriangleMesh(mesh.vertices, mesh.faces[order], {"heat": mesh.vertices[:, 0]})


def test_the_faces_of_a_large_surface_are_sorted_and_nothing_else_changes() -> None:
    given = shuffled(LARGE)
    found = Resampler(given, Thresholds(0.1)).mesh
    assert np.array_equal(found.vertices, given.vertices)
    assert np.array_equal(found.attributes["heat"], given.attributes["heat"])
    assert (np.diff(found.faces.min(axis=1)) >= 0).all()
    assert sorted(found.faces.tolist()) == sorted(given.faces.tolist())


def test_a_small_surface_stays_as_it_is() -> None:
    small = shuffled(icosphere(8))
    assert in_memory_order(small) is small


def test_a_large_surface_resumes_with_the_same_bits() -> None:
    thresholds = Thresholds(0.04)
    straight = Resampler(shuffled(LARGE), thresholds)
    straight.vertices[:] *= [1.3, 0.8, 1.0]
    straight.resample()
    resumed = Resampler.from_state(straight.state(), thresholds)
    for each in (straight, resumed):
        each.vertices[:] *= [0.8, 1.3, 1.0]
        assert each.resample().splits > 0
    assert straight.mesh.faces.tobytes() == resumed.mesh.faces.tobytes()
    assert straight.mesh.vertices.tobytes() == resumed.mesh.vertices.tobytes()


def test_a_large_surface_keeps_its_creases() -> None:
    mesh = LARGE.with_creases(LARGE.faces[:40, :2])
    assert np.array_equal(Resampler(mesh, Thresholds(0.1)).mesh.creases, mesh.creases)


def by_identity(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices and attribute in the order of identities, and faces that name identities, sorted."""
    names = mesh.attributes["identity"]
    faces = names[mesh.faces]
    turned = np.stack([np.roll(row, -np.argmin(row)) for row in faces])
    order = np.argsort(names)
    return mesh.vertices[order], mesh.attributes["heat"][order], turned[np.lexsort(turned.T)]


def test_sorting_changes_numbers_alone() -> None:
    ball = with_identities(shuffled(icosphere(12))).with_creases(icosphere(12).faces[:40, :2])
    mesh = HalfedgeMesh(ball)
    mesh.reorder(np.random.default_rng(3).permutation(len(ball.vertices)))
    after = mesh.snapshot()
    for one, other in zip(by_identity(ball), by_identity(after), strict=True):
        assert np.array_equal(one, other)
    assert (np.diff(after.faces.min(axis=1)) >= 0).all()
    assert np.array_equal(mesh.twins, HalfedgeMesh(after).twins)
    crease_ends = [np.unique(np.sort(m.attributes["identity"][m.creases]), axis=0) for m in (ball, after)]
    assert np.array_equal(*crease_ends)


def test_a_surface_is_sorted_when_a_third_of_its_vertices_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.resample.resampler._CACHED", 1000)
    resampler = Resampler(with_identities(icosphere(12)), Thresholds(0.25))
    resampler.resample()
    assert resampler.unsorted == 0, "no vertex had been sorted before"
    new = 0
    for _ in range(12):
        resampler.vertices[:, 0] += 0.2 * resampler.vertices[:, 2]
        report = resampler.resample()
        new = 0 if 3 * (new + report.splits) > report.vertices else new + report.splits
        assert resampler.unsorted == new
        is_sorted = (np.diff(resampler.mesh.faces.min(axis=1)) >= 0).all()
        assert is_sorted == (new == 0)
        validate(resampler.mesh).require(closed=True)
