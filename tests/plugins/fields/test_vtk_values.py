"""Arrays of numbers in VTK files, as what looks of sequences show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.shot import read_shot
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("sequences")

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], float)
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def row(kind: str, name: str, values: Any) -> str:
    return f'<DataArray type="{kind}" Name="{name}" format="ascii">{" ".join(map(str, values))}</DataArray>'


def write_tent(path: Path, level: float) -> None:
    """Write a tent whose heat is x + level at points, 10 at cells, and unknown at the second point."""
    heat = CORNERS[:, 0] + level
    at_points = row("Float64", "heat", heat) + row(
        "Float64", "gaps", np.where(np.arange(5) == 1, np.nan, heat)
    )
    polygons = row("Int64", "connectivity", FACES.ravel()) + row("Int64", "offsets", [3, 6, 9, 12])
    points = '<DataArray type="Float64" NumberOfComponents="3" format="ascii">'
    points += f"{' '.join(map(str, CORNERS.ravel()))}</DataArray>"
    cells = row("Float64", "load", [10.0] * 4)
    piece = (
        f'<Piece NumberOfPoints="5" NumberOfPolys="4"><Points>{points}</Points><Polys>{polygons}</Polys>'
        f"<PointData>{at_points}</PointData><CellData>{cells}</CellData></Piece>"
    )
    path.write_text(f'<VTKFile type="PolyData" version="1.0"><PolyData>{piece}</PolyData></VTKFile>')


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tents")
    for number in (1, 2, 3):
        write_tent(folder / f"tent_{number:04d}.vtp", float(number))
    return folder


def shot_of(folder: Path, values: str, more: str = "") -> Any:
    subject = f"{{sequence: tent_####.vtp, values: {values}{more}}}"
    look = "{material: clay, measure: {values: {range: [0%, 100%]}}}"
    return read_shot(folder / "a.yaml", f"title: T\nframes: 1-3\nsubject: {subject}\nlook: {look}\n")


def test_every_frame_has_the_numbers_of_its_file_and_the_range_of_all(folder: Path) -> None:
    shot = shot_of(folder, "heat")
    for frame in animate(shot):
        summed, known = frame.mesh.attributes["values"].T
        assert (known == 1.0).all()
        assert summed == pytest.approx(frame.mesh.vertices[:, 0] + frame.number)
    assert shot.picture.look.pattern.range == pytest.approx((1.0, 4.0))


def test_between_files_numbers_go_along(folder: Path) -> None:
    frames = list(animate(shot_of(folder, "heat", ", rate: 12, start: 1")))
    summed = frames[1].mesh.attributes["values"][:, 0]
    assert summed == pytest.approx(frames[1].mesh.vertices[:, 0] + 1.5)


def test_numbers_of_cells_are_averaged_and_those_that_are_none_are_missing(folder: Path) -> None:
    (frame,) = animate(shot_of(folder, "load"), only=frozenset({2}))
    assert frame.mesh.attributes["values"][:, 0] == pytest.approx(10.0)
    (frame,) = animate(shot_of(folder, "gaps"), only=frozenset({2}))
    at = np.flatnonzero((frame.mesh.vertices == CORNERS[1]).all(axis=1))
    known = frame.mesh.attributes["values"][:, 1]
    assert (known[at] == 0.0).all() and known.sum() == len(known) - len(at)


@pytest.mark.parametrize(
    ("values", "more", "message"),
    [
        ("heet", "", "tent_0001.vtp: it has no numbers 'heet'. Did you mean 'heat'?"),
        ("heat", ", faces: fixed", "Leave faces out, or write changing"),
        ("heat, fit: 2", ", paint: on", "paint"),
    ],
)
def test_mistakes_are_named_with_their_place_and_remedy(
    folder: Path, values: str, more: str, message: str
) -> None:
    with pytest.raises(ShotError, match=r"a\.yaml:3:") as caught:
        shot_of(folder, values, more)
    assert message in str(caught.value)
