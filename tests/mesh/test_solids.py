"""Subjects have the shape, the size and the resolution they are asked for."""

import math

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus, validate


def volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def edge_lengths(mesh: TriangleMesh) -> Floats:
    ends = mesh.vertices[mesh.faces]
    return np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)


def test_a_box_has_its_size_and_flat_sides() -> None:
    mesh = box((1, 2, 3), edge_length=0.3, centre=(5, 0, 0))
    assert np.allclose(mesh.bounds, [(4.5, -1, -1.5), (5.5, 1, 1.5)])
    assert volume(mesh) == pytest.approx(6)
    assert np.allclose(np.abs(mesh.face_normals).max(axis=1), 1)
    assert edge_lengths(mesh).max() <= 0.3 * math.sqrt(2) + 1e-12


def test_a_box_without_edge_length_is_twelve_triangles() -> None:
    assert len(box().faces) == 12
    assert len(box().vertices) == 8


@pytest.mark.parametrize("frequency", [1, 2, 7])
def test_a_geodesic_sphere_has_ten_n_squared_plus_two_vertices(frequency: int) -> None:
    mesh = icosphere(frequency, radius=3.0, centre=(1, 2, 3))
    assert len(mesh.vertices) == 10 * frequency**2 + 2
    assert np.allclose(np.linalg.norm(mesh.vertices - (1, 2, 3), axis=1), 3)
    assert edge_lengths(mesh).max() < 1.5 * edge_lengths(mesh).min()


@pytest.mark.parametrize(
    ("mesh", "exact"),
    [
        (icosphere(24), 4 / 3 * math.pi),
        (torus(1.0, 0.4, 0.05), 2 * math.pi**2 * 0.4**2),
        (rod(3.0, 0.5, 0.05), math.pi * 0.25 * 2 + 4 / 3 * math.pi * 0.125),
        (rod(3.0, 0.5, 0.05, caps="flat"), math.pi * 0.25 * 3),
        (rod(1.0, 0.5, 0.05), 4 / 3 * math.pi * 0.125),
    ],
    ids=["sphere", "torus", "rod", "flat rod", "rod that is a ball"],
)
def test_curved_solids_are_closed_face_outwards_and_hold_their_volume(
    mesh: TriangleMesh, exact: float
) -> None:
    validate(mesh).require(closed=True)
    assert 0.98 * exact < volume(mesh) < exact


@pytest.mark.parametrize("mesh", [torus(1, 0.4, 0.1), rod(3, 0.5, 0.1), rod(3, 0.5, 0.1, caps="flat")])
def test_edges_are_near_the_length_asked_for(mesh: TriangleMesh) -> None:
    lengths = edge_lengths(mesh)
    assert lengths.min() > 0.05
    assert lengths.max() < 0.16


def test_a_sheet_faces_upwards() -> None:
    mesh = sheet((2, 4), 0.25)
    assert np.allclose(mesh.face_normals, (0, 1, 0))
    assert np.allclose(mesh.bounds, [(-1, 0, -2), (1, 0, 2)])


@pytest.mark.parametrize(
    "make",
    [
        lambda: box(0.0),
        lambda: box(edge_length=-1.0),
        lambda: icosphere(0),
        lambda: icosphere(4, radius=math.nan),
        lambda: torus(0.4, 1.0),
        lambda: rod(0.5, 0.5),
        lambda: rod(caps="square"),
    ],
)
def test_sizes_that_cannot_be_are_refused(make: object) -> None:
    assert callable(make)
    with pytest.raises(UsageError):
        make()
