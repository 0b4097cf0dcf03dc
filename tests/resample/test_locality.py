"""Large surfaces get their faces in the order of their vertices; nobody else notices."""

import numpy as np

from pipeline.mesh import TriangleMesh, icosphere
from pipeline.resample import Resampler, Thresholds
from pipeline.resample.resampler import in_memory_order

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
