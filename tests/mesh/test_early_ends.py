"""Mesh files that end early: what is told of each format, and that no cut file is read as a whole surface."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.read import ModelFile
from tests.needed_plugins import needs_plugins, shot_rows

BALL = trimesh.creation.icosphere(1)

FILES = {
    "binary.stl": BALL.export(file_type="stl"),
    "text.stl": BALL.export(file_type="stl_ascii").encode(),
    "binary.ply": BALL.export(file_type="ply"),
    "text.ply": BALL.export(file_type="ply", encoding="ascii"),
    "ball.glb": BALL.export(file_type="glb"),
    "ball.off": BALL.export(file_type="off").encode(),
}
"""One surface of 42 vertices and 80 triangles, by the name of its file."""

REMEDY = "Copy or export it again."


def after(name: str, mark: bytes, times: int = 1, start: int = 0) -> int:
    """Return the number of bytes of a file from its beginning to the end of its n-th mark."""
    for _ in range(times):
        start = FILES[name].index(mark, start) + len(mark)
    return start


PLY_HEADERS = {name: after(name, b"end_header\n") for name in ("binary.ply", "text.ply")}


def told(folder: Path, name: str, size: int) -> str:
    """Return the message about a file cut to a number of bytes, without its folder."""
    path = folder / name
    path.write_bytes(FILES[name][:size])
    with pytest.raises(MeshError) as error:
        ModelFile(path).surface()
    return str(error.value).replace(f"{folder}/", "")


@pytest.mark.parametrize(
    ("name", "size", "fact"),
    shot_rows(
        [
            ("binary.stl", 2084, "STL (it ends early: its header promises 80 triangles, and 40 are there)"),
            ("binary.stl", 60, "STL (it ends early: it has 60 bytes, and its header alone needs 84)"),
            (
                "text.stl",
                after("text.stl", b"endfacet", 18),
                "STL (it ends early: endsolid is missing after 18 triangles)",
            ),
            (
                "binary.ply",
                PLY_HEADERS["binary.ply"] + 18 * 12 + 5,
                "PLY (it ends early: its header promises 42 vertices, and 18 are there)",
            ),
            (
                "binary.ply",
                PLY_HEADERS["binary.ply"] + 42 * 12 + 61 * 13 + 5,
                "PLY (it ends early: its header promises 80 faces, and 61 are there)",
            ),
            (
                "text.ply",
                after("text.ply", b"\n", 22, PLY_HEADERS["text.ply"]),
                "PLY (it ends early: its header promises 42 vertices, and 22 are there)",
            ),
            (
                "ball.glb",
                900,
                f"GLB (it ends early: its header promises {len(FILES['ball.glb'])} bytes, and 900",
            ),
            (
                "ball.off",
                after("ball.off", b"\n", 20),
                "OFF (it ends early: its header promises 42 vertices, and 18 are there)",
            ),
        ]
    ),
)
def test_a_cut_mesh_file_is_told_with_what_its_header_promises(
    tmp_path: Path, name: str, size: int, fact: str
) -> None:
    message = told(tmp_path, name, size)
    assert message.startswith(f"{name}: cannot be read as {fact}")
    assert message.endswith(REMEDY)


@pytest.mark.parametrize("name", shot_rows(FILES))
def test_an_empty_mesh_file_is_told_as_such(tmp_path: Path, name: str) -> None:
    assert told(tmp_path, name, 0) == f"{name}: the file is empty. {REMEDY}"


@needs_plugins("interchange")
@given(
    name=st.sampled_from(sorted(FILES)),
    part=st.floats(0, 0.9),
)
@settings(max_examples=60, deadline=None)
def test_no_cut_mesh_file_is_read(tmp_path_factory: pytest.TempPathFactory, name: str, part: float) -> None:
    message = told(tmp_path_factory.mktemp("cut"), name, int(part * len(FILES[name])))
    assert message.startswith(f"{name}: ") and message.endswith(REMEDY)
