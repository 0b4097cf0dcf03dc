"""Written meshes: what each format keeps, and that no half file is ever seen."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from flowsculpt.pipeline.errors import MachineError, MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, box, icosphere, read_mesh, validate
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh


def ball() -> TriangleMesh:
    """A sphere at coordinates that float32 cannot hold, with attributes of several kinds."""
    mesh = icosphere(4, 1 / 3, (0.1, 0.2, 0.3))
    normals = (mesh.vertices - (0.1, 0.2, 0.3)) * 3
    count = len(mesh.vertices)
    return mesh.with_attributes(
        normal=normals, heat=np.linspace(0, 1, count), tag=np.arange(count) % 7, rest=mesh.vertices + 1
    )


@pytest.mark.parametrize("suffix", ["ply", "obj", "off"])
def test_these_formats_keep_every_bit_of_the_coordinates(tmp_path: Path, suffix: str) -> None:
    mesh = ball()
    write_mesh(mesh, tmp_path / f"a.{suffix}")
    again = read_mesh(tmp_path / f"a.{suffix}")
    corners = again.vertices[again.faces]
    np.testing.assert_array_equal(corners, mesh.vertices[mesh.faces])


@pytest.mark.parametrize("suffix", ["stl", "glb"])
def test_these_formats_keep_float32(tmp_path: Path, suffix: str) -> None:
    mesh = ball()
    write_mesh(mesh, tmp_path / f"a.{suffix}")
    again = read_mesh(tmp_path / f"a.{suffix}")
    assert validate(again).require(closed=True).euler == 2
    np.testing.assert_array_equal(
        again.vertices[again.faces].astype(np.float32), mesh.vertices[mesh.faces].astype(np.float32)
    )


def test_ply_carries_the_attributes_as_numbers_others_can_read(tmp_path: Path) -> None:
    mesh = ball()
    write_mesh(mesh, tmp_path / "a.ply")
    read = trimesh.load(tmp_path / "a.ply", process=False)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(data["heat"], mesh.attributes["heat"])
    np.testing.assert_array_equal(data["rest_y"], mesh.attributes["rest"][:, 1])
    np.testing.assert_array_equal(data["tag"], mesh.attributes["tag"])
    np.testing.assert_allclose(read.vertex_normals, mesh.attributes["normal"], atol=1e-6)


@pytest.mark.parametrize("suffix", ["ply", "obj", "glb"])
def test_texture_coordinates_are_where_other_programs_read_them(tmp_path: Path, suffix: str) -> None:
    mesh = ball().with_attributes(uv=np.random.default_rng(1).random((162, 2)))
    write_mesh(mesh, tmp_path / f"a.{suffix}")
    read = trimesh.load(tmp_path / f"a.{suffix}", process=False, force="mesh")
    uv, corners = mesh.attributes["uv"][mesh.faces], read.visual.uv[read.faces]
    np.testing.assert_allclose(read.vertices[read.faces], mesh.vertices[mesh.faces], atol=1e-7)
    np.testing.assert_allclose(corners, uv, atol=1e-7)


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_texture_coordinates_of_another_shape_are_refused(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(MeshError, match=r"attribute 'uv' has shape \(162, 3\); it must be \(162, 2\)"):
        write_mesh(ball().with_attributes(uv=np.zeros((162, 3))), tmp_path / f"a.{suffix}")
    assert not list(tmp_path.iterdir())


def test_stl_is_what_others_read(tmp_path: Path) -> None:
    write_mesh(ball(), tmp_path / "a.stl")
    read = trimesh.load(tmp_path / "a.stl")
    assert read.is_watertight and read.volume == pytest.approx(
        trimesh.Trimesh(ball().vertices, ball().faces).volume
    )
    stored = np.frombuffer((tmp_path / "a.stl").read_bytes()[84:], "<f4,<f4,<f4,V36,<u2")
    np.testing.assert_allclose(
        read.face_normals, np.stack([stored[f"f{k}"] for k in range(3)], axis=1), atol=1e-5
    )


def test_glb_is_what_the_standard_asks_for(tmp_path: Path) -> None:
    write_mesh(box(), tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    magic, version, length, words, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    scene = json.loads(data[20 : 20 + words])
    assert scene["buffers"][0]["byteLength"] == len(data) - 28 - words
    assert all(view["byteOffset"] % 4 == 0 for view in scene["bufferViews"])
    attributes = scene["meshes"][0]["primitives"][0]["attributes"]
    assert set(attributes) == {"POSITION", "NORMAL"}
    assert scene["accessors"][attributes["POSITION"]]["max"] == [1.0, 1.0, 1.0]


def test_npz_keeps_everything(tmp_path: Path) -> None:
    mesh = box().with_creases([[0, 1]]).with_attributes(heat=np.ones(len(box().vertices), np.float32))
    write_mesh(mesh, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_array_equal(arrays["vertices"], mesh.vertices)
        np.testing.assert_array_equal(arrays["faces"], mesh.faces)
        np.testing.assert_array_equal(arrays["creases"], [[0, 1]])
        assert arrays["attribute:heat"].dtype == np.float32


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    target = tmp_path / "a.ply"
    target.mkdir()
    with pytest.raises(MachineError, match=r"a\.ply: cannot be written"):
        write_mesh(box(), target)
    assert list(tmp_path.iterdir()) == [target]


def test_formats_that_cannot_be_written_are_told_with_those_that_can(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="use one of ply, obj, off, stl, glb, npz"):
        write_mesh(box(), tmp_path / "a.fbx")


@pytest.mark.parametrize("suffix", ["ply", "obj", "off"])
def test_polygons_stay_polygons(tmp_path: Path, suffix: str) -> None:
    house = PolygonMesh(
        [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0], [1, 0, 3]],
        [[0, 4, 3, 2, 1], [0, 1, 5], [1, 2, 5], [2, 3, 5], [3, 4, 5], [4, 0, 5]],
    )
    write_mesh(house, tmp_path / f"a.{suffix}")
    data = (tmp_path / f"a.{suffix}").read_bytes()
    five = {
        "obj": b"f 1 5 4 3 2\n",
        "off": b"\n5 0 4 3 2 1\n",
        "ply": b"\x05" + np.array([0, 4, 3, 2, 1], "<i4").tobytes() + b"\x03",
    }
    assert five[suffix] in data


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "off"])
def test_a_written_mesh_is_read_back_whole(tmp_path: Path, suffix: str) -> None:
    mesh = icosphere(5)
    write_mesh(mesh, tmp_path / f"ball.{suffix}")
    again = read_mesh(tmp_path / f"ball.{suffix}")
    assert validate(again).require(closed=True).euler == 2
    assert len(again.vertices) == len(mesh.vertices)
    assert np.allclose(np.sort(again.vertices, axis=0), np.sort(mesh.vertices, axis=0), atol=1e-6)


def test_polygons_are_triangulated_and_objects_joined(tmp_path: Path) -> None:
    file = tmp_path / "tray.obj"
    file.write_text(
        "o one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
        "o two\nv 1 0 0\nv 2 0 0\nv 2.5 .5 0\nv 2 1 0\nv 1 1 0\nf 5 6 7 8 9\n"
    )
    mesh = read_mesh(file)
    assert len(mesh.faces) == 5
    assert len(mesh.vertices) == 7, "the two polygons share an edge"


def test_a_scene_is_joined_into_one_mesh(tmp_path: Path) -> None:
    scene = trimesh.Scene([trimesh.Trimesh(m.vertices, m.faces) for m in (box(), box(1.0, centre=(9, 0, 0)))])
    scene.export(tmp_path / "two.glb")
    assert validate(read_mesh(tmp_path / "two.glb")).require(closed=True).euler == 4


def test_a_format_that_is_not_known_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="not a mesh format"):
        write_mesh(box(), tmp_path / "box.doc")


def test_a_folder_that_is_a_file_is_the_environments_fault(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(MachineError, match="cannot be written"):
        write_mesh(box(), tmp_path / "taken" / "box.ply")
