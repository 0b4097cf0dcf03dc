"""Mesh files come in as one connected surface, or with a sentence that says why not."""

from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.mesh import read_mesh
from flowsculpt.pipeline.mesh.read import ModelFile, mesh_suffixes
from flowsculpt.render.base.input_files import InputFile


def _of_formats(*rows: tuple[str, Any, Any]) -> list[tuple[str, Any, Any]]:
    """Return rows about files, by their names, without those of formats whose plug-in is missing."""
    return [row for row in rows if row[0].rpartition(".")[2] in {"txt", *mesh_suffixes()}]


def test_a_missing_file_is_a_missing_input(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match=r"nothing\.ply: file not found"):
        read_mesh(tmp_path / "nothing.ply")


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    _of_formats(
        ("a.txt", "hello", "not a mesh format"),
        ("a.obj", "", "the file is empty"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces|cannot be read"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "not finite"),
        ("a.ply", "this is no ply", "cannot be read"),
        ("a.glb", "this is no glb", "cannot be read"),
        ("a.stl", "this is no stl", "cannot be read|no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", r"vertex 3 is at \(0, nan, 0\)"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 1\n", "degenerate"),
    ),
)
def test_a_bad_file_is_named_with_its_fault(tmp_path: Path, name: str, content: str, fault: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(MeshError, match=fault) as error:
        read_mesh(tmp_path / name)
    assert str(error.value).startswith(str(tmp_path / name))


@pytest.mark.parametrize(
    ("name", "content", "was_misread"),
    _of_formats(
        ("a.obj", b"v 0 0 0\n", False),
        ("a.obj", b"\xef\xbb\xbfv 0 0 0\n", True),
        ("a.obj", b"mtllib C:\\a.mtl\nv 1 \\\n0 0\n", False),
        ("a.obj", b"o chair\r\nusemtl C:\\maps\\\r\nf 1 2 3\r\n", True),
        ("a.off", b"OFF\n3 1 0\n", False),
        ("a.off", b"# by hand\nST4OFF 3 1 0\n", True),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 1\n", False),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 1\nelement tristrips 1\n", True),
        ("a.stl", b"\xef\xbb\xbfsolid", False),
    ),
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
@pytest.mark.parametrize("suffix", sorted({"glb", "obj", "stl", "ply", "dae", "fbx"} & {*mesh_suffixes()}))
def test_content_of_another_kind_is_named_in_place_of_a_model(
    tmp_path: Path, suffix: str, content: bytes, fact: str
) -> None:
    (tmp_path / f"m.{suffix}").write_bytes(content)
    with pytest.raises(MeshError, match=f"it is {fact}"):
        read_mesh(tmp_path / f"m.{suffix}")
