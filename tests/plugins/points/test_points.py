"""Points and nets from files: what is read, and what bad files are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.mesh import TriangleMesh, box
from flowsculpt.pipeline.plugins.points.point_files import read_net, read_points
from tests.needed_plugins import needs_plugins

POINTS = np.random.default_rng(1).normal(size=(7, 3))
SIZES = np.linspace(0.1, 0.7, 7)


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 30), st.integers(0, 99))
def test_a_cloud_that_was_written_reads_back(
    tmp_path_factory: pytest.TempPathFactory, n: int, seed: int
) -> None:
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    points = np.random.default_rng(seed).normal(size=(n, 3))
    cloud = TriangleMesh(points, [], {"size": np.arange(1.0, n + 1)})
    folder = tmp_path_factory.mktemp("clouds")
    for suffix in ("ply", "npz", "obj"):
        write_mesh(cloud, folder / f"a.{suffix}")
        found = read_points(folder / f"a.{suffix}")
        assert np.array_equal(found.points, points)
        if suffix != "obj":
            assert np.array_equal(found.attributes["size"], np.arange(1.0, n + 1))


def test_lines_of_numbers_are_points_and_what_is_beside_them(tmp_path: Path) -> None:
    file = tmp_path / "a.xyz"
    file.write_text("# a comment\n0 0 1 0.5\n\n1, 2, 3, 0.25  # the second\n")
    found = read_points(file)
    assert found.points.tolist() == [[0, 0, 1], [1, 2, 3]]
    assert found.attributes["column_4"].tolist() == [0.5, 0.25]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_lines_of_numbers_of_other_systems_lose_nothing(tmp_path: Path, encoding: str, line_end: str) -> None:
    file = tmp_path / "a.xyz"
    file.write_bytes("1;2;3 # Höhe\n4, 5, 6\n7\t8 9\n".replace("\n", line_end).encode(encoding))
    assert read_points(file).points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_the_vertices_of_a_model_are_points(tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    write_mesh(box(), tmp_path / "a.obj")
    assert len(read_points(tmp_path / "a.obj").points) == 8


def test_only_numbers_one_a_point_are_attributes(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "a.npz", points=POINTS, size=SIZES, names=np.array(list("abcdefg")), other=np.arange(3)
    )
    assert set(read_points(tmp_path / "a.npz").attributes) == {"size"}


def bad(**arrays: np.ndarray) -> dict[str, np.ndarray]:
    return arrays


WILD = np.where(np.arange(21).reshape(7, 3) == 9, np.nan, POINTS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xyz", "", "a.xyz: the file is empty. Copy or export it again."),
        ("a.xyz", "# none\n", "a.xyz: it has no points; a cloud needs at least one"),
        ("a.xyz", "0 0 1\n0 0\n", "a.xyz: cannot be read as XYZ .point 1 has 2 numbers"),
        ("a.xyz", "0 0 1\n0 0 one\n", "a.xyz: cannot be read as XYZ .line 2: one is not a number"),
        ("a.xyz", "x,y,z\n0,0,1\n", "a.xyz: cannot be read as XYZ .line 1: x is not a number"),
        (
            "a.xyz",
            "0,5 1,25 2,0\n",
            "line 1: 0,5 1,25 2,0: commas separate numbers, and decimals have a point",
        ),
        ("a.xyz", "0;1,25;2\n", "line 1: 0 1,25 2: commas separate numbers, and decimals have a point"),
        ("a.xyz", "0 0 1\n0 0 1D3\n", "line 2: 1D3 is not a number"),
        ("a.xyz", "0 0 1\n0 0 1\0\n", "line 2: byte 11 is NUL"),
        ("a.xyz", "0 0 1\n0 nan 1\n0 inf 1\n", r"a.xyz: point 1 is not finite .and 1 more.; coordinates"),
        pytest.param("a.obj", "# nothing\n", "a.obj: it has no points", marks=needs_plugins("interchange")),
        pytest.param(
            "a.ply",
            "no header",
            "a.ply: cannot be read as PLY .it has no PLY header",
            marks=needs_plugins("interchange"),
        ),
        pytest.param(
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
            "no x, y and z",
            marks=needs_plugins("interchange"),
        ),
        ("a.npz", "no archive", "a.npz: cannot be read as NPZ"),
        ("a.npz", bad(size=SIZES), "a.npz: it has no array points or vertices. There are: size."),
        ("a.npz", bad(points=POINTS[:, :2]), r"a.npz: its points have shape .7, 2.; they must be .N, 3."),
        ("a.npz", bad(points=np.float64(1)), r"a.npz: its points have shape ..; they must be .N, 3."),
        ("a.npz", bad(points=np.empty((0, 3))), "a.npz: it has no points"),
        ("a.npz", bad(points=WILD), r"a.npz: point 3 is not finite .and 0 more."),
        ("a.npz", bad(points=np.array(["a", "b"])), "a.npz: cannot be read as NPZ"),
        pytest.param(
            "a.las",
            "x",
            "a.las: .las is not a file of points; use one of ply, xyz, npz, obj",
            marks=needs_plugins("interchange"),
        ),
    ],
)
def test_a_bad_file_of_points_is_told_in_one_line(
    tmp_path: Path, name: str, content: str | dict[str, np.ndarray], message: str
) -> None:
    if isinstance(content, str):
        (tmp_path / name).write_text(content)
    else:
        np.savez(tmp_path / name, **content)  # type: ignore[arg-type]
    with pytest.raises(MeshError, match=message) as error:
        read_points(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_a_missing_input(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match="file not found"):
        read_points(tmp_path / "a.ply")


GRID = np.random.default_rng(2).normal(size=(4, 5, 3))


def test_a_net_reads_as_rows_from_a_grid_or_a_list(tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    np.savez(tmp_path / "a.npz", points=GRID)
    np.savez(tmp_path / "b.npz", points=GRID.reshape(-1, 3))
    write_mesh(TriangleMesh(GRID.reshape(-1, 3), []), tmp_path / "c.obj")
    for net in (
        read_net(tmp_path / "a.npz"),
        read_net(tmp_path / "a.npz", 5),
        read_net(tmp_path / "b.npz", 5),
        read_net(tmp_path / "c.obj", 5),
    ):
        assert np.array_equal(net, GRID)


@pytest.mark.parametrize(
    ("points", "columns", "message"),
    [
        (GRID, 4, "a.npz: its rows have 5 points, not 4; leave columns out"),
        (
            GRID.reshape(-1, 3),
            None,
            "a.npz: its points are one list; write columns, the number of points in a row",
        ),
        (GRID.reshape(-1, 3), 6, "a.npz: 20 points cannot make rows of 6; correct columns"),
        (GRID[..., :2], None, r"a.npz: its points have shape .4, 5, 2.; they must be .rows, columns, 3."),
        (
            np.where(GRID[1, 2, 0] == GRID, np.inf, GRID),
            None,
            "a.npz: the point in row 1, column 2 is not finite",
        ),
    ],
)
def test_a_bad_file_of_a_net_is_told_in_one_line(
    tmp_path: Path, points: np.ndarray, columns: int | None, message: str
) -> None:
    np.savez(tmp_path / "a.npz", points=points)
    with pytest.raises(MeshError, match=message):
        read_net(tmp_path / "a.npz", columns)
