"""Mesh files come in as one connected surface, or with a sentence that says why not."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from flowsculpt.pipeline.errors import MachineError, MeshError, MissingInputError
from flowsculpt.pipeline.mesh import box, icosphere, read_mesh, validate
from flowsculpt.pipeline.mesh.read import ModelFile, mesh_suffixes
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.render.base.input_files import InputFile


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


def test_a_missing_file_is_a_missing_input(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match=r"nothing\.obj: file not found"):
        read_mesh(tmp_path / "nothing.obj")


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        ("a.txt", "hello", "not a mesh format"),
        ("a.obj", "", "the file is empty"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces|cannot be read"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "not finite"),
        ("a.ply", "this is no ply", "cannot be read"),
        ("a.glb", "this is no glb", "cannot be read"),
        ("a.stl", "this is no stl", "cannot be read|no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", r"vertex 3 is at \(0, nan, 0\)"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 1\n", "degenerate"),
    ],
)
def test_a_bad_file_is_named_with_its_fault(tmp_path: Path, name: str, content: str, fault: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(MeshError, match=fault) as error:
        read_mesh(tmp_path / name)
    assert str(error.value).startswith(str(tmp_path / name))


def test_a_format_that_is_not_known_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="not a mesh format"):
        write_mesh(box(), tmp_path / "box.doc")


def test_a_folder_that_is_a_file_is_the_environments_fault(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(MachineError, match="cannot be written"):
        write_mesh(box(), tmp_path / "taken" / "box.ply")


@pytest.mark.parametrize(
    ("name", "content", "was_misread"),
    [
        ("a.obj", b"v 0 0 0\n", False),
        ("a.obj", b"\xef\xbb\xbfv 0 0 0\n", True),
        ("a.obj", b"mtllib C:\\a.mtl\nv 1 \\\n0 0\n", False),
        ("a.obj", b"o chair\r\nusemtl C:\\maps\\\r\nf 1 2 3\r\n", True),
        ("a.off", b"OFF\n3 1 0\n", False),
        ("a.off", b"# by hand\nST4OFF 3 1 0\n", True),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 1\n", False),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 1\nelement tristrips 1\n", True),
        ("a.stl", b"\xef\xbb\xbfsolid", False),
    ],
)
def test_the_digest_of_a_model_moves_only_where_an_earlier_reader_misread_it(
    tmp_path: Path, name: str, content: bytes, was_misread: bool
) -> None:
    (tmp_path / name).write_bytes(content)
    files = ModelFile(tmp_path / name).files()
    assert files.files == ((tmp_path / name, InputFile(tmp_path / name).digest()),)
    assert (files.digest != InputFile(tmp_path / name).digest()) == was_misread


_POINTER = f"version https://git-lfs.github.com/spec/v1\noid sha256:{7:064}\nsize 12345\n".encode()


@pytest.mark.parametrize("suffix", mesh_suffixes())
def test_a_pointer_of_git_lfs_is_named_as_such_in_place_of_any_model(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m.{suffix}"
    path.write_bytes(_POINTER)
    for read in read_mesh, lambda file: ModelFile(file).files():
        with pytest.raises(MissingInputError, match=r"pointer of Git LFS.*git lfs pull"):
            read(path)


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        (b"\n<!DOCTYPE html><title>404</title>", "an HTML page"),
        (b"\x1f\x8b\x08\0\0\0\0\0", "a gzip archive"),
        (b"PK\x03\x04\x14\0", "a ZIP archive"),
        (b"\0\x05\x16\x07\0\x02\0\0Mac OS X", "a file that macOS writes beside another"),
        (b"bplist00\xd1", "a property list of macOS"),
        (bytes(4096), "nothing but bytes of 0"),
    ],
)
@pytest.mark.parametrize("suffix", ["glb", "obj", "stl", "ply", "dae", "fbx"])
def test_content_of_another_kind_is_named_in_place_of_a_model(
    tmp_path: Path, suffix: str, content: bytes, fact: str
) -> None:
    (tmp_path / f"m.{suffix}").write_bytes(content)
    with pytest.raises(MeshError, match=f"it is {fact}"):
        read_mesh(tmp_path / f"m.{suffix}")
