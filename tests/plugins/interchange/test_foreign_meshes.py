"""Meshes of trimesh and PyVista: joined where their vertices are double, and textured as before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from flowsculpt import (
    Curved,
    MeshError,
    PolygonMesh,
    Resampler,
    TextureCoordinates,
    Thresholds,
    TriangleMesh,
    UsageError,
    read_mesh,
    repair_mesh,
    validate,
    write_mesh,
)
from flowsculpt.pipeline.mesh.solids import square_grid


def ring(m: int = 24, n: int = 12) -> TriangleMesh:
    """A torus as trimesh and PyVista have it: `uv` (V, 2) from 0 to 1, and vertices double at both seams."""
    uv, faces = square_grid(m, n)
    around, along = 2 * np.pi * uv.T
    width = 1 + 0.4 * np.cos(along)
    points = [width * np.cos(around), 0.4 * np.sin(along), -width * np.sin(around)]
    heat = np.cos(around)
    return TriangleMesh(np.column_stack(points), faces, {"uv": uv, "heat": heat})


def place_of(uv: NDArray[np.float64]) -> NDArray[np.float64]:
    around, along = 2 * np.pi * uv.T
    width = 1 + 0.4 * np.cos(along)
    return np.column_stack([width * np.cos(around), 0.4 * np.sin(along), -width * np.sin(around)])


def test_vertices_that_are_double_become_one_and_keep_their_attributes() -> None:
    double = ring()
    far = np.array([[1e9, 0.0, 0.0], [np.nan, 0.0, 0.0]])  # of no face
    more = {name: np.concatenate([values, values[:2]]) for name, values in double.attributes.items()}
    among, dropped = repair_mesh(TriangleMesh(np.concatenate([double.vertices, far]), double.faces, more))
    assert "2 vertices belong to no face" in dropped[1]
    mesh, changes = repair_mesh(double)
    np.testing.assert_array_equal(among.attributes["heat"], mesh.attributes["heat"])
    assert validate(double).boundary_edges > 0 and validate(mesh).closed and len(mesh.vertices) == 24 * 12
    assert changes == (
        "37 vertices lie on others, the first at (1.4, 0, 0), vertex 12: merged",
        "attribute 'uv' of 37 vertices differs from that of others there: dropped",
    )
    np.testing.assert_allclose(place_of(mesh.attributes["uv"]), mesh.vertices, atol=1e-12)
    np.testing.assert_allclose(mesh.attributes["heat"], np.cos(2 * np.pi * mesh.attributes["uv"][:, 0]))


def test_quads_with_vertices_of_their_own_become_one_closed_surface_with_its_creases() -> None:
    """As `pyvista.Cube` has them: six faces, and four vertices for each."""
    cube = trimesh.creation.box()
    lone = trimesh.Trimesh(
        cube.vertices[cube.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    mesh, _ = repair_mesh(TriangleMesh(lone.vertices, lone.faces))
    assert validate(mesh).closed and (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    square = PolygonMesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), [range(4)], creases=[[0, 1]])
    assert repair_mesh(square)[0].creases.tolist() == [[0, 1]]


@pytest.mark.parametrize("per_corner", [False, True])
def test_texture_coordinates_stay_on_the_surface_and_no_face_crosses_a_seam(per_corner: bool) -> None:
    double = ring()
    uv = double.attributes["uv"]
    texture = TextureCoordinates(double.vertices, double.faces, uv[double.faces] if per_corner else uv)
    mesh, _ = repair_mesh(double)
    sculpture = Resampler(texture.prepare(mesh), Thresholds(0.12), Curved())
    for _ in range(6):
        sculpture.vertices[:] *= [1.15, 1.0, 0.95]
        sculpture.resample()
    found = texture.split(sculpture.mesh)
    assert len(found.faces) > 2 * len(double.faces)
    assert len(found.vertices) > len(sculpture.mesh.vertices)  # double at seams
    corners = found.attributes["uv"][found.faces]
    assert np.ptp(corners, axis=1).max() < 0.2  # a smeared face would have 1
    np.testing.assert_allclose(place_of(found.attributes["uv"]), found.attributes["rest"], atol=0.08)
    np.testing.assert_array_equal(found.vertices[found.faces], sculpture.mesh.vertices[sculpture.mesh.faces])
    assert found.attributes["heat"].shape == (len(found.vertices),)


def test_a_textured_file_is_resampled_and_written_as_a_textured_file(tmp_path: Path) -> None:
    write_mesh(ring(), tmp_path / "ring.obj")
    texture = TextureCoordinates.read(tmp_path / "ring.obj")
    sculpture = Resampler(texture.prepare(read_mesh(tmp_path / "ring.obj")), Thresholds(0.15))
    sculpture.resample()
    write_mesh(texture.split(sculpture.mesh), tmp_path / "even.obj")
    even = trimesh.load(tmp_path / "even.obj", process=False)
    np.testing.assert_allclose(place_of(np.asarray(even.visual.uv)), even.vertices, atol=0.06)
    assert np.ptp(np.asarray(even.visual.uv)[even.faces], axis=1).max() < 0.2


def test_what_cannot_be_textured_is_refused(tmp_path: Path) -> None:
    double = ring()
    with pytest.raises(MeshError, match=r"uv has shape \(5, 2\); it must be \(325, 2\)"):
        TextureCoordinates(double.vertices, double.faces, np.zeros((5, 2)))
    with pytest.raises(MeshError, match="not finite"):
        TextureCoordinates(double.vertices, double.faces, np.full((325, 2), np.nan))
    with pytest.raises(MeshError, match="no faces"):
        TextureCoordinates(double.vertices, [], np.zeros((325, 2)))
    texture = TextureCoordinates(double.vertices, double.faces, double.attributes["uv"])
    mesh, _ = repair_mesh(double)
    with pytest.raises(UsageError, match="Prepare the mesh before it moves"):
        texture.prepare(mesh.with_vertices(1.1 * mesh.vertices))
    with pytest.raises(UsageError, match="resample what `prepare` returns"):
        texture.split(mesh)
    write_mesh(TriangleMesh(double.vertices, double.faces), tmp_path / "bare.obj")
    with pytest.raises(MeshError, match=r"bare\.obj: it has no texture coordinates"):
        TextureCoordinates.read(tmp_path / "bare.obj")
