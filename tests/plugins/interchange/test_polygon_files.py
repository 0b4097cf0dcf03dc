"""Polygons, groups and creases come in as the file has them; nothing is cut, nothing forgotten."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, icosphere, read_mesh, read_polygons, validate
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

POINTS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
VERTICES = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS)
TOP_EDGES = [[2, 3], [2, 6], [3, 7], [6, 7]]


def written(path: Path, *statements: str) -> Path:
    path.write_text(VERTICES + "\n".join(statements))
    return path


def f(face: int) -> str:
    return "f " + " ".join(str(v + 1) for v in QUADS[face])


def polygons(mesh: PolygonMesh) -> list[list[int]]:
    return [mesh.face(k).tolist() for k in range(len(mesh))]


@pytest.mark.parametrize("suffix", ["obj", "ply", "off"])
def test_polygons_are_read_as_they_were_written(tmp_path: Path, suffix: str) -> None:
    pentagon = [(0, 0, 0), (2, 0, 0), (3, 0, -1), (1, 0, -1.5), (0.1, 0, -1), (1, 0, 1)]
    mesh = PolygonMesh(pentagon, [(0, 1, 2, 3, 4), (1, 0, 5)])
    write_mesh(mesh, tmp_path / f"two.{suffix}")
    again = read_polygons(tmp_path / f"two.{suffix}")
    assert polygons(again) == [[0, 1, 2, 3, 4], [1, 0, 5]]
    assert np.array_equal(again.vertices, mesh.vertices)


@pytest.mark.parametrize("suffix", ["stl", "glb"])
def test_a_format_of_triangles_gives_polygons_of_three_sides(tmp_path: Path, suffix: str) -> None:
    write_mesh(icosphere(3), tmp_path / f"ball.{suffix}")
    assert validate(read_polygons(tmp_path / f"ball.{suffix}")).require(closed=True).euler == 2


def test_a_concave_polygon_of_a_file_is_cut_into_triangles_that_do_not_overlap(tmp_path: Path) -> None:
    comb = [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (4, 1), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)]
    text = "".join(f"v {x} {y} 0\n" for x, y in comb) + "f " + " ".join(str(k + 1) for k in range(12))
    (tmp_path / "comb.obj").write_text(text)
    mesh = read_mesh(tmp_path / "comb.obj")
    areas = PolygonMesh.from_triangles(mesh).area_vectors[:, 2]
    assert len(mesh.faces) == 10
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(7 + 2 * 1 * 3)


def test_relative_numbers_texture_corners_and_broken_lines_are_understood(tmp_path: Path) -> None:
    file = tmp_path / "cube.obj"
    faces = ["f -8 -7 \\\n -5 -6", "f 5/1 7/2 8/3 6/4", "f 1//1 5//1 6//1 2//1", "f 3/1/1 4/1/1 8/1/1 7/1/1"]
    written(file, "vt 0 0", "vn 0 0 1", *faces, f(4), f(5), "l 1 2", "# end")
    assert polygons(read_polygons(file)) == [list(quad) for quad in QUADS]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("o body", "o lid"),
        ("g body", "g lid"),
        ("s 1", "s 2"),
        ("s off", "s 1"),
        ("usemtl clay", "usemtl tin"),
    ],
)
def test_edges_between_groups_are_creases(tmp_path: Path, first: str, second: str) -> None:
    lid = 3
    others = [f(k) for k in range(6) if k != lid]
    mesh = read_polygons(written(tmp_path / "cube.obj", first, *others, second, f(lid)))
    assert mesh.creases.tolist() == TOP_EDGES
    assert read_mesh(tmp_path / "cube.obj").creases.tolist() == TOP_EDGES


def test_faces_without_smoothing_are_one_group(tmp_path: Path) -> None:
    mesh = read_polygons(written(tmp_path / "cube.obj", "s off", *(f(k) for k in range(6))))
    assert len(mesh.creases) == 0


def test_crease_tags_of_a_file_are_creases_where_they_are_edges(tmp_path: Path) -> None:
    tags = [
        "t crease 2/1/0 2 3 4.5",
        "t crease 3/1/0 3 7 6 2",
        "t crease 2/1/0 0 7 9",
        "t crease 2/1/0 0 1 0",
    ]
    mesh = read_polygons(written(tmp_path / "cube.obj", *(f(k) for k in range(6)), *tags))
    assert mesh.creases.tolist() == [[2, 3], [3, 7], [6, 7]]


def test_creases_survive_a_file(tmp_path: Path) -> None:
    mesh = PolygonMesh(POINTS, QUADS, creases=TOP_EDGES)
    write_mesh(mesh, tmp_path / "cube.obj")
    assert read_polygons(tmp_path / "cube.obj").creases.tolist() == TOP_EDGES


def test_objects_that_meet_are_joined_and_their_seam_is_a_crease(tmp_path: Path) -> None:
    (tmp_path / "tray.obj").write_text(
        "o one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
        "o two\nv 1 0 0\nv 2 0 0\nv 2.5 .5 0\nv 2 1 0\nv 1 1 0\nf 5 6 7 8 9\n"
    )
    mesh = read_polygons(tmp_path / "tray.obj")
    assert mesh.sides.tolist() == [4, 5]
    assert mesh.creases.tolist() == [[1, 2]]


PLY = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
FACES = "element face 2\nproperty list uchar int vertex_index\nproperty short mark\nend_header\n"


def test_an_off_file_may_have_comments_colours_and_its_counts_on_the_first_line(tmp_path: Path) -> None:
    (tmp_path / "two.off").write_text(
        "OFF 5 2 0 # counts\n\n0 0 0\n1 0 0\n1 1 0\n# corner\n0 1 0\n2 .5 0\n4 0 1 2 3 255 0 0\n3 2 1 4\n"
    )
    assert polygons(read_polygons(tmp_path / "two.off")) == [[0, 1, 2, 3], [2, 1, 4]]


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
            "face 1 names vertex 9; the file has 3 vertices, numbered from 1",
        ),
        ("a.obj", "v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "vertex 2 has 2 coordinates"),
        ("a.obj", "v 0 0 0\nv 1 zero 0\n", "line 2: v 1 zero 0"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4.*numbered from 1"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "cannot be read as OFF"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0 has 2 of its 3 corners"),
        ("a.ply", f"ply\nformat ascii 1.0\n{PLY}{FACES}0 0 0 9\n", "promises 5 vertices, and 1 is there"),
        ("a.ply", f"ply\nformat binary_little_endian 1.0\n{PLY}{FACES}0 0 0", "cannot be read as PLY"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "no x, y and z"),
    ],
)
def test_what_is_wrong_with_a_polygon_file_is_said(
    tmp_path: Path, name: str, content: str, fault: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(MeshError, match=fault) as error:
        read_polygons(tmp_path / name)
    assert str(error.value).startswith(str(tmp_path / name))


def test_a_file_of_triangles_is_read_alike_as_polygons_and_triangles(tmp_path: Path) -> None:
    write_mesh(icosphere(6), tmp_path / "ball.ply")
    mesh, cut = read_polygons(tmp_path / "ball.ply"), read_mesh(tmp_path / "ball.ply")
    assert validate(cut).require(closed=True).faces == len(mesh)
    assert np.array_equal(mesh.corners.reshape(-1, 3), cut.faces)
