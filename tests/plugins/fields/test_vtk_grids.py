"""Grids of VTK in several pieces, turned, with data at cells, and collections of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MissingInputError, UsageError
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples

SIZE = (5, 4, 3)


def velocity(points: np.ndarray) -> np.ndarray:
    """Return a linear field, which any interpolation reproduces."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([1.0 + x - z, 2.0 * y, 3.0 + 0.5 * x + y], -1)


def piece(
    extent: tuple[int, ...], at_cells: bool = False, turn: np.ndarray | None = None, kind: str = "ImageData"
) -> str:
    """Return a piece of a grid with spacing 0.5 from the origin (1, 0, 0) on, in the directions of `turn`."""
    ranges = [np.arange(extent[k], extent[k + 1] + (not at_cells)) + 0.5 * at_cells for k in (0, 2, 4)]
    index = np.stack(np.meshgrid(*ranges, indexing="ij"), -1)
    points = np.array([1.0, 0.0, 0.0]) + 0.5 * index @ (np.eye(3) if turn is None else turn).T
    numbers = " ".join(f"{number:.9g}" for number in velocity(points).transpose(2, 1, 0, 3).ravel())
    place = "CellData" if at_cells else "PointData"
    coordinates = ""
    if kind == "RectilinearGrid":
        begin = (1.0, 0.0, 0.0)
        axes = [begin[k] + 0.5 * np.arange(extent[2 * k], extent[2 * k + 1] + 1) for k in range(3)]
        coordinates = "<Coordinates>" + "".join(
            f'<DataArray type="Float64" format="ascii">{" ".join(map(str, axis))}</DataArray>'
            for axis in axes
        )
        coordinates += "</Coordinates>"
    return (
        f'<Piece Extent="{" ".join(map(str, extent))}"><{place}><DataArray type="Float64" Name="u" '
        f'NumberOfComponents="3" format="ascii">{numbers}</DataArray></{place}>{coordinates}</Piece>'
    )


def grid(file: Path, *pieces: str, turn: np.ndarray | None = None, kind: str = "ImageData") -> Path:
    direction = "" if turn is None else f'Direction="{" ".join(map(repr, turn.ravel().tolist()))}"'
    about = f'Origin="1 0 0" Spacing="0.5 0.5 0.5" {direction}' if kind == "ImageData" else ""
    file.write_text(
        f'<VTKFile type="{kind}" byte_order="LittleEndian"><{kind} WholeExtent="0 4 0 3 0 2" {about}>'
        f"{''.join(pieces)}</{kind}></VTKFile>"
    )
    return file


WHOLE = (0, 4, 0, 3, 0, 2)
PARTS = ((0, 2, 0, 3, 0, 2), (2, 4, 0, 3, 0, 1), (2, 4, 0, 3, 1, 2))


def require_field(file: Path, turn: np.ndarray | None = None, inside: float = 0.0) -> None:
    """Check velocities between nodes, and their gradient."""
    field = Sampled(read_samples((file,)).samples)
    share = np.random.default_rng(5).uniform(inside, 1.0 - inside, (50, 3))
    local = 0.5 * share * (np.array(SIZE) - 1)
    points = np.array([1.0, 0.0, 0.0]) + local @ (np.eye(3) if turn is None else turn).T
    np.testing.assert_allclose(field.velocity(points, 0.0), velocity(points), atol=1e-7)
    gradient = np.array([[1.0, 0.0, -1.0], [0.0, 2.0, 0.0], [0.5, 1.0, 0.0]])
    assert field.gradient_bound(0.0) >= np.linalg.norm(gradient, 2) - 1e-9


@pytest.mark.parametrize("kind", ["ImageData", "RectilinearGrid"])
def test_pieces_of_a_file_are_put_together(tmp_path: Path, kind: str) -> None:
    require_field(grid(tmp_path / "a.vti", *(piece(part, kind=kind) for part in PARTS), kind=kind))


def parallel(folder: Path, kind: str = "ImageData") -> Path:
    suffix = "vti" if kind == "ImageData" else "vtr"
    listed = ""
    (folder / "a").mkdir()
    for k, part in enumerate(PARTS):
        grid(folder / "a" / f"{k}.{suffix}", piece(part, kind=kind), kind=kind)
        listed += f'<Piece Extent="{" ".join(map(str, part))}" Source="a/{k}.{suffix}"/>'
    file = folder / f"a.p{suffix}"
    file.write_text(
        f'<VTKFile type="P{kind}"><P{kind} WholeExtent="0 4 0 3 0 2">{listed}</P{kind}></VTKFile>'
    )
    return file


@pytest.mark.parametrize("kind", ["ImageData", "RectilinearGrid"])
def test_files_of_a_parallel_file_are_put_together_and_all_count(tmp_path: Path, kind: str) -> None:
    file = parallel(tmp_path, kind)
    require_field(file)
    read = read_samples((file,))
    assert [path.name[0] for path, _ in read.files] == ["a", "0", "1", "2"]
    before = read.samples.digest(0)
    changed = tmp_path / "a" / f"2.{file.suffix[2:]}"
    changed.write_text(changed.read_text().replace("</VTKFile>", " </VTKFile>"))
    assert read_samples((file,)).samples.digest(0) != before
    changed.unlink()
    with pytest.raises(MissingInputError, match="file not found"):
        read_samples((file,))


def test_data_at_cells_are_averaged_to_points_and_that_is_said(tmp_path: Path) -> None:
    file = grid(tmp_path / "a.vti", piece(WHOLE, at_cells=True))
    require_field(file, inside=0.5)
    assert read_samples((file,)).notes == ("a.vti: data at cells are averaged to points",)


def turn_about(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.roll(np.roll(np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]]), axis, 0), axis, 1)


@pytest.mark.parametrize(
    "turn", [turn_about(2, 90.0), turn_about(0, 30.0) @ turn_about(1, 50.0), np.diag([1.0, -1.0, 1.0])]
)
def test_turned_grids_keep_their_velocities_in_the_world(tmp_path: Path, turn: np.ndarray) -> None:
    require_field(grid(tmp_path / "a.vti", piece(WHOLE, turn=turn), turn=turn), turn)


def test_a_collection_has_times(tmp_path: Path) -> None:
    entries = ""
    for k, time in enumerate((0.5, 2.0, 1.0)):
        grid(tmp_path / f"wind_{k}.vti", piece(WHOLE).replace("ImageData", "ImageData"))
        entries += f'<DataSet timestep="{time}" part="0" file="wind_{k}.vti"/>'
    file = tmp_path / "wind.pvd"
    file.write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    read = read_samples((file,))
    assert read.samples.times.tolist() == [0.5, 1.0, 2.0]
    assert [path.name for path, _ in read.files] == ["wind.pvd", "wind_0.vti", "wind_2.vti", "wind_1.vti"]


WRONG = {
    "a gap": (lambda f: grid(f, *(piece(part) for part in PARTS[:2])), "its pieces leave gaps"),
    "skewed axes": (
        lambda f: grid(f, piece(WHOLE), turn=np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]])),
        "are not perpendicular",
    ),
    "points and cells": (
        lambda f: grid(f, piece(PARTS[0]), *(piece(part, at_cells=True) for part in PARTS[1:])),
        "some pieces have velocities at points and others at cells",
    ),
    "no pieces": (lambda f: grid(f), "it has no pieces"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_grid_is_refused(tmp_path: Path, what: str) -> None:
    write, says = WRONG[what]
    with pytest.raises(UsageError, match=says):
        read_samples((write(tmp_path / "a.vti"),))


def test_names_outside_of_the_folder_and_meshes_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.pvti"
    file.write_text(
        '<VTKFile type="PImageData"><PImageData><Piece Source="../b.vti"/></PImageData></VTKFile>'
    )
    with pytest.raises(UsageError, match=r"it names \.\./b\.vti, which is not beside it"):
        read_samples((file,))
    (tmp_path / "a.vtp").write_text("<VTKFile type='PolyData'/>")
    with pytest.raises(UsageError, match=r"\.vtp is not a format of fields.*\(Resample To Image\)"):
        read_samples((tmp_path / "a.vtp",))
