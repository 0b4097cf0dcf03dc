"""Surfaces in files of VTK and ParaView: polygons, skins of grids, several pieces, and files with times."""

from __future__ import annotations

import shutil
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import (
    FlowsculptError,
    FrameError,
    MeshError,
    MissingInputError,
)
from flowsculpt.pipeline.mesh.mesh_formats import FileSurface
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.fields import vtk_surfaces
from flowsculpt.pipeline.plugins.fields.vtk_surfaces import read_surface
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.base.input_files import BadInputError
from tests.needed_plugins import needs_plugins

WRITTEN = Path(__file__).parent / "vtk"
CUBES = sorted(file.name for file in WRITTEN.glob("cubes_*.vtu"))


def faces_of(surface: FileSurface) -> list[np.ndarray]:
    return np.split(surface.corners, surface.offsets[1:-1])


def volume(surface: FileSurface, faces: list[np.ndarray]) -> float:
    """Return the volume in closed faces; below 0 where they face inwards."""
    fans = [(surface.points[face[0]], a, b) for face in faces for a, b in pairwise(face[1:])]
    return sum(np.linalg.det([p, surface.points[a], surface.points[b]]) for p, a, b in fans) / 6.0


def is_closed(faces: list[np.ndarray]) -> bool:
    sides = Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))
    return all(sides[b, a] == count == 1 for (a, b), count in sides.items())


@pytest.mark.parametrize("name", CUBES)
def test_files_of_vtk_are_read_in_every_encoding(name: str) -> None:
    surface = read_surface(WRITTEN / name)
    faces = faces_of(surface)
    assert len(faces) == 24 and is_closed(faces)  # the skin: none of the faces between the cubes
    assert volume(surface, faces) == pytest.approx(8.0)
    assert surface.velocities is not None
    np.testing.assert_allclose(surface.velocities, surface.points * [1, 0, -1])


def test_every_kind_of_cell_has_its_faces_outwards_and_lines_and_points_are_left_out_with_a_note() -> None:
    surface = read_surface(WRITTEN / "every_cell.vtu")
    at: dict[int, list[np.ndarray]] = {}
    for face in faces_of(surface):
        at.setdefault(int(surface.points[face, 0].min() // 3), []).append(face)
    solids = [at[place] for place in range(8)]
    assert [len(faces) for faces in solids] == [4, 6, 6, 5, 5, 7, 8, 6]
    assert all(map(is_closed, solids))
    volumes = [volume(surface, faces) for faces in solids]
    np.testing.assert_allclose([*volumes[:5], volumes[7]], [1 / 6, 1, 1, 1 / 2, 1 / 3, 1])
    assert min(volumes) > 0.0
    # a triangle, a pixel, a quadrilateral, a polygon, and a strip of three triangles
    assert sorted(len(face) for face in at[8]) == [3, 3, 3, 3, 4, 4, 5]
    assert surface.notes == ("2 lines left out", "2 points left out")


def test_strips_are_triangles_and_normals_are_read() -> None:
    surface = read_surface(WRITTEN / "strips.vtp")
    faces = faces_of(surface)
    assert {len(face) for face in faces} == {3} and is_closed(faces)
    assert volume(surface, faces) > 0.0
    assert surface.normals is not None
    np.testing.assert_allclose(surface.normals, 2 * surface.points, atol=1e-6)


# Files written here


def array(name: str, values: object, width: int = 1, kind: str = "Float64") -> str:
    text = " ".join(map(str, np.ravel(np.array(values)).tolist()))
    head = f'type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii"'
    return f"<DataArray {head}>{text}</DataArray>"


def lists(rows: list[list[int]]) -> str:
    ends = np.cumsum([len(row) for row in rows]).tolist()
    flat = [corner for row in rows for corner in row]
    return array("connectivity", flat, kind="Int64") + array("offsets", ends, kind="Int64")


def grid_piece(points: np.ndarray, cells: list[tuple[int, list[int]]], more: str = "") -> str:
    """Return a piece of an unstructured grid."""
    own = lists([corners for _, corners in cells]) + array("types", [kind for kind, _ in cells], kind="UInt8")
    return (
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}">{more}'
        f"<Points>{array('Points', points, 3)}</Points><Cells>{own}</Cells></Piece>"
    )


def write_grid(path: Path, *pieces: str) -> Path:
    text = "".join(pieces)
    path.write_text(f'<VTKFile type="UnstructuredGrid"><UnstructuredGrid>{text}</UnstructuredGrid></VTKFile>')
    return path


def write_polygons(
    path: Path, points: object, faces: list[list[int]], more: str = "", lines: int = 0
) -> Path:
    rows = np.array(points, float).reshape(-1, 3)
    segments = [[0, 1]] * lines
    path.write_text(
        f'<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="{len(rows)}" NumberOfLines="{lines}" '
        f'NumberOfPolys="{len(faces)}">{more}<Points>{array("Points", rows, 3)}</Points>'
        f"<Lines>{lists(segments)}</Lines><Polys>{lists(faces)}</Polys></Piece></PolyData></VTKFile>"
    )
    return path


CORNERS = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
RIGHT, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
CUBE = [0, 1, 3, 2, 4, 5, 7, 6]
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def test_no_skin_lies_between_the_pieces_of_a_grid(tmp_path: Path) -> None:
    one, other = grid_piece(CORNERS, [(12, CUBE)]), grid_piece(CORNERS + RIGHT, [(12, CUBE)])
    parts = [write_grid(tmp_path / "a.vtu", one), write_grid(tmp_path / "b.vtu", other)]
    named = "".join(f'<Piece Source="{part.name}"/>' for part in parts)
    root = tmp_path / "whole.pvtu"
    root.write_text(
        f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>{named}</PUnstructuredGrid></VTKFile>'
    )
    for path in (write_grid(tmp_path / "c.vtu", one, other), root):
        surface = read_surface(path)
        assert len(faces_of(surface)) == 10 and is_closed(faces_of(surface))
        assert volume(surface, faces_of(surface)) == pytest.approx(2.0)
    assert [file for file, _ in ModelFile(root).files().files] == [root, *parts]
    parts[1].unlink()
    with pytest.raises(MissingInputError, match=r"b\.vtu: file not found"):
        ModelFile(root).surface()


def test_cells_that_another_piece_has_too_are_left_out(tmp_path: Path) -> None:
    ghosts = f"<CellData>{array('vtkGhostType', [0, 1], kind='UInt8')}</CellData>"
    points = np.vstack([CORNERS, CORNERS + RIGHT])
    both = grid_piece(points, [(12, CUBE), (12, [corner + 8 for corner in CUBE])], ghosts)
    surface = read_surface(write_grid(tmp_path / "a.vtu", both))
    assert surface.points[surface.corners].max() == 1.0 and len(faces_of(surface)) == 6


def test_flat_cells_on_solid_ones_and_inverted_cells_do_not_disturb_the_skin(tmp_path: Path) -> None:
    turned = [*CUBE[4:], *CUBE[:4]]
    piece = grid_piece(CORNERS, [(12, turned), (9, [0, 1, 3, 2])])
    surface = read_surface(write_grid(tmp_path / "a.vtu", piece))
    assert len(faces_of(surface)) == 6 and volume(surface, faces_of(surface)) == pytest.approx(1.0)


def test_pieces_of_polygons_are_one_surface(tmp_path: Path) -> None:
    sides = [SQUARES[:5], SQUARES[5:]]
    for part, faces in enumerate(sides):
        write_polygons(tmp_path / f"{part}.vtp", CORNERS, faces)
    named = '<Piece Source="0.vtp"/><Piece Source="1.vtp"/>'
    (tmp_path / "a.pvtp").write_text(f'<VTKFile type="PPolyData"><PPolyData>{named}</PPolyData></VTKFile>')
    mesh = ModelFile(tmp_path / "a.pvtp").surface().mesh
    assert len(mesh.vertices) == 8 and len(mesh.offsets) == 7


def test_normals_of_a_grid_are_read(tmp_path: Path) -> None:
    data = f"<PointData>{array('Normals', CORNERS - 0.5, 3)}</PointData>"
    surface = read_surface(write_grid(tmp_path / "a.vtu", grid_piece(CORNERS, [(12, CUBE)], data)))
    assert surface.normals is not None
    np.testing.assert_array_equal(surface.normals, CORNERS - 0.5)


def test_velocities_of_cells_become_means_at_points_where_points_have_none(tmp_path: Path) -> None:
    data = f"<CellData>{array('U', [[2, 0, 0], [4, 0, 0]], 3)}</CellData>"
    path = write_polygons(tmp_path / "a.vtp", CORNERS[:4], [[0, 1, 2], [1, 3, 2]], data)
    velocities = read_surface(path).velocities
    assert velocities is not None
    np.testing.assert_allclose(velocities[:, 0], [2, 3, 3, 4])


def test_polyhedra_are_read_as_older_versions_wrote_them(tmp_path: Path) -> None:
    stream = [6, *(number for face in SQUARES for number in (4, *face))]
    faces = array("faces", stream, kind="Int64") + array("faceoffsets", [len(stream)], kind="Int64")
    piece = grid_piece(CORNERS, [(42, [*range(8)])]).replace("</Cells>", f"{faces}</Cells>")
    surface = read_surface(write_grid(tmp_path / "a.vtu", piece))
    assert is_closed(faces_of(surface)) and volume(surface, faces_of(surface)) == pytest.approx(1.0)


# Files with times


def read(folder: Path, sequence: str, frames: str = "1-3") -> Shot:
    text = f"title: A\nframes: {frames}\nsubject: {{sequence: {sequence}}}\nresample: off\n"
    (folder / "a.yaml").write_text(text)
    return read_shot(folder / "a.yaml")


def write_series(folder: Path, times: list[float], split: bool = False) -> Path:
    """Write a cube that rises, with a time for each position; with `split` its last face is a file apart."""
    rows = []
    for number, time in enumerate(times):
        points = CORNERS + number * UP
        parts = [SQUARES[:5], SQUARES[5:]] if split else [SQUARES]
        for part, faces in enumerate(parts):
            name = f"frames/cube_{number}_{part}.vtp"
            (folder / "frames").mkdir(exist_ok=True)
            write_polygons(folder / name, points, faces)
            rows.append(f'<DataSet timestep="{time}" group="" part="{part}" file="{name}"/>')
    path = folder / "cube.pvd"
    path.write_text(f'<VTKFile type="Collection"><Collection>{"".join(rows)}</Collection></VTKFile>')
    return path


@needs_plugins("sequences")
@pytest.mark.parametrize("split", [False, True], ids=["one file", "files of parts"])
def test_a_pvd_shows_its_files_at_their_times(tmp_path: Path, split: bool) -> None:
    path = write_series(tmp_path, [0.5, 0.5 + 1 / 24, 0.5 + 2 / 24], split)
    frames = list(animate(read(tmp_path, "cube.pvd")))
    assert [frame.mesh.vertices[:, 1].min() for frame in frames] == [0, 1, 2]
    assert all(len(frame.mesh.vertices) == 8 for frame in frames)
    moving = ModelFile(path).motion()
    np.testing.assert_allclose(moving.times, [0.5, 0.5 + 1 / 24, 0.5 + 2 / 24])
    assert moving.is_fixed and {file.name for file, _ in moving.files.files} > {"cube.pvd", "cube_2_0.vtp"}


@needs_plugins("sequences")
def test_times_of_a_pvd_are_seconds_unless_the_shot_says_how_many_files_a_second_there_are(
    tmp_path: Path,
) -> None:
    write_series(tmp_path, [0, 1, 2])
    frames = list(animate(read(tmp_path, "cube.pvd", "1-49")))
    np.testing.assert_allclose([frames[k].mesh.vertices[:, 1].min() for k in (0, 12, 24, 48)], [0, 0.5, 1, 2])
    frames = list(animate(read(tmp_path, "cube.pvd, rate: 24")))
    assert [frame.mesh.vertices[:, 1].min() for frame in frames] == [0, 1, 2]


@needs_plugins("sequences")
def test_faces_of_a_pvd_may_change_and_its_velocities_and_normals_are_those_of_its_files(
    tmp_path: Path,
) -> None:
    fast = array("velocity", [[0, 12, 0]] * 8, 3) + array("Normals", CORNERS - 0.5, 3)
    for number, faces in enumerate([SQUARES, SQUARES[:5], SQUARES[:4]]):
        path = tmp_path / f"{number}.vtp"
        write_polygons(path, CORNERS + number * UP, faces, f"<PointData>{fast}</PointData>")
    rows = "".join(f'<DataSet timestep="{number / 12}" file="{number}.vtp"/>' for number in range(3))
    collection(tmp_path, rows).rename(tmp_path / "cube.pvd")
    frames = list(animate(read(tmp_path, "cube.pvd", "1-5")))
    heights = [float(frame.mesh.vertices[:, 1].min()) for frame in frames]
    np.testing.assert_allclose(heights, [0, 0.5, 1, 1.5, 2])
    assert [len(frame.mesh.faces) for frame in frames][::2] == [12, 10, 8]
    normals = frames[2].mesh.attributes["normal"]
    np.testing.assert_allclose(normals, (CORNERS - 0.5) / np.sqrt(0.75), atol=1e-12)
    np.testing.assert_allclose(frames[2].mesh.attributes["velocity"], 12 * np.tile(UP, (8, 1)))


def test_a_pvd_of_one_time_is_a_model_and_not_a_sequence(tmp_path: Path) -> None:
    path = write_series(tmp_path, [3.0])
    assert len(ModelFile(path).surface().mesh.vertices) == 8
    with pytest.raises(MeshError, match="it has one time, so nothing moves in it"):
        ModelFile(path).motion()


def test_a_larger_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_series(tmp_path, [0, 1])
    monkeypatch.setattr(vtk_surfaces, "_LARGEST", 500)
    with pytest.raises(BadInputError, match=r"cube_0_0\.vtp: it has .*; files of up to"):
        ModelFile(path).motion().at(0.0)


def test_a_file_of_a_pvd_that_changes_while_frames_are_made_is_an_error(tmp_path: Path) -> None:
    moving = ModelFile(write_series(tmp_path, [0, 1, 2])).motion()
    write_polygons(tmp_path / "frames/cube_1_0.vtp", 2 * CORNERS, SQUARES)
    assert moving.at(0.5).points.max() == 1.0
    with pytest.raises(MissingInputError, match=r"cube\.pvd: a file that it names changed"):
        moving.at(1.0)


@needs_plugins("sequences")
def test_numbered_files_of_vtk_are_a_sequence(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        write_polygons(tmp_path / f"cube_{number}.vtp", CORNERS + number * UP, SQUARES)
    frames = list(animate(read(tmp_path, "cube_#.vtp")))
    assert [frame.mesh.vertices[:, 1].min() for frame in frames] == [1, 2, 3]


# What cannot be read


def spoilt(tmp_path: Path, name: str, old: str, new: str) -> Path:
    path = tmp_path / name
    shutil.copy(WRITTEN / name, path)
    content = path.read_bytes()
    assert old.encode() in content
    path.write_bytes(content.replace(old.encode(), new.encode(), 1))
    return path


def cut_short(tmp_path: Path, name: str, share: float) -> Path:
    path = tmp_path / name
    content = (WRITTEN / name).read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    return path


def made(tmp_path: Path, kind: int, corners: list[int]) -> Path:
    return write_grid(
        tmp_path / "a.vtu", grid_piece(np.random.default_rng(0).random((20, 3)), [(kind, corners)])
    )


def collection(tmp_path: Path, row: str) -> Path:
    path = tmp_path / "a.pvd"
    path.write_text(f'<VTKFile type="Collection"><Collection>{row}</Collection></VTKFile>')
    return path


REFUSED = {
    "curved cells": (
        lambda f: made(f, 24, [*range(10)]),
        "piece 0: cell 0 has VTK's type 24; only cells with straight edges are read, .*Tessellate it",
    ),
    "cells with too few points": (lambda f: made(f, 12, [*range(7)]), "cell 0 of VTK's type 12 has 7 points"),
    "missing points": (lambda f: made(f, 5, [0, 1, 20]), "a cell names point 20; there are 20 points"),
    "negative points": (lambda f: made(f, 5, [0, 1, -2]), "a cell names point -2"),
    "lines alone": (
        lambda f: write_polygons(f / "a.vtp", CORNERS, [], lines=2),
        "it has no faces; a surface needs at least one triangle; 2 lines left out",
    ),
    "empty pieces": (lambda f: write_polygons(f / "a.vtp", [], []), "it has no faces"),
    "appended data cut short": (
        lambda f: cut_short(f, "cubes_raw.vtu", 0.8),
        "bytes are announced, but|begins at",
    ),
    "base64 cut short": (
        lambda f: cut_short(f, "cubes_base64_big_endian.vtu", 0.8),
        "bytes are announced, but|begins at",
    ),
    "text cut short": (lambda f: cut_short(f, "cubes_ascii.vtu", 0.5), "not XML"),
    "fewer points than promised": (
        lambda f: spoilt(f, "cubes_ascii.vtu", 'NumberOfPoints="27"', 'NumberOfPoints="28"'),
        "has 81 numbers, not 84",
    ),
    "more points than can be": (
        lambda f: spoilt(f, "cubes_ascii.vtu", 'NumberOfPoints="27"', 'NumberOfPoints="9999999999"'),
        "NumberOfPoints is '9999999999'; it must be a number up to",
    ),
    "offsets that do not ascend": (
        lambda f: spoilt(f, "cubes_ascii.vtu", "8 16 24", "8 24 16"),
        "offsets in Cells do not ascend",
    ),
    "an unknown compressor": (
        lambda f: spoilt(f, "cubes_raw_lz4.vtu", "vtkLZ4Data", "vtkZstdData"),
        "compressed by vtkZstdDataCompressor",
    ),
    "another data set": (
        lambda f: spoilt(f, "cubes_ascii.vtu", 'type="UnstructuredGrid"', 'type="ImageData"'),
        "its type is ImageData, not UnstructuredGrid",
    ),
    "a time that is not a number": (
        lambda f: collection(f, '<DataSet timestep="now" file="a.vtp"/>'),
        "timestep 'now' is not a number",
    ),
    "no times": (lambda f: collection(f, ""), "it names no files"),
    "an absolute path": (
        lambda f: collection(f, '<DataSet timestep="0" file="/tmp/a.vtp"/>'),
        "write names relative to its own folder",
    ),
    "an address": (
        lambda f: collection(f, '<DataSet timestep="0" file="https://a/a.vtp"/>'),
        "write names relative to its own folder",
    ),
    "files of another kind": (
        lambda f: collection(f, '<DataSet timestep="0" file="blocks.vtm"/>'),
        r"it names blocks\.vtm; surfaces are read from \.vtp, \.vtu, \.pvtp, \.pvtu",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_one_line_with_the_file_and_a_remedy(name: str, tmp_path: Path) -> None:
    make, says = REFUSED[name]
    path = make(tmp_path)
    with pytest.raises(MeshError, match=says) as error:
        ModelFile(path).surface()
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)
    assert str(error.value).count(str(path)) == 1


def test_a_file_cut_short_anywhere_is_refused_or_read_whole(tmp_path: Path) -> None:
    whole = read_surface(WRITTEN / "cubes_raw_lz4.vtu")
    size = (WRITTEN / "cubes_raw_lz4.vtu").stat().st_size
    for end in range(1, size, 29):
        path = cut_short(tmp_path, "cubes_raw_lz4.vtu", end / size)
        try:
            surface = ModelFile(path).surface()
        except FlowsculptError as error:
            assert str(path) in str(error)
        else:
            assert len(surface.mesh.vertices) == len(np.unique(whole.corners))


@needs_plugins("sequences")
def test_a_damaged_file_of_a_pvd_fails_its_frame_with_its_name(tmp_path: Path) -> None:
    write_series(tmp_path, [0, 1 / 24, 2 / 24, 3 / 24])
    (tmp_path / "frames/cube_2_0.vtp").write_text("")
    shot = read(tmp_path, "cube.pvd", "1-4")
    with pytest.raises(FrameError, match=r"frame 2: .*cube\.pvd: at 0\.0833333 s: cube_2_0\.vtp: not XML"):
        list(animate(shot))
