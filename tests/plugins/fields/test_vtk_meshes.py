"""Velocities in `.vts` and `.vtu`: on an even grid as they are in their cells, or refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples

SIDES = 9, 8, 7


def bent() -> np.ndarray:
    """Return the points (N, 3) of a box that is bent and sheared; x is the fastest."""
    k, j, i = np.meshgrid(*(np.linspace(0.0, 1.0, count) for count in SIDES[::-1]), indexing="ij")
    radius, angle = 1.0 + i, 1.2 * j
    return np.column_stack(
        [(radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel(), (k + 0.2 * i).ravel()]
    )


def velocity_of(points: np.ndarray) -> np.ndarray:
    """Return velocities that are linear, so that any cut of cells gives the same."""
    return points @ np.array([[0.3, -1.0, 0.5], [1.0, 0.2, 0.0], [0.4, 0.0, -0.7]]) + [1.0, 2.0, 3.0]


def array(name: str, values: np.ndarray, kind: str = "Float64", width: int = 1) -> str:
    text = " ".join(map(repr, np.asarray(values).ravel().tolist()))
    head = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">'
    return f"{head}{text}</DataArray>"


def vts(points: np.ndarray, shape: tuple[int, int, int] = SIDES, velocity: np.ndarray | None = None) -> str:
    extent = " ".join(f"0 {count - 1}" for count in shape)
    own = velocity_of(points) if velocity is None else velocity
    return (
        f'<VTKFile type="StructuredGrid"><StructuredGrid WholeExtent="{extent}"><Piece Extent="{extent}">'
        f"<PointData>{array('U', own, width=3)}</PointData>"
        f"<Points>{array('Points', points, width=3)}</Points></Piece></StructuredGrid></VTKFile>"
    )


def vtu(points: np.ndarray, cells: list[tuple[int, list[int]]]) -> str:
    ends = np.cumsum([len(corners) for _, corners in cells])
    lists = array("connectivity", np.concatenate([corners for _, corners in cells]), "Int64")
    lists += array("offsets", ends, "Int64") + array("types", np.array([kind for kind, _ in cells]), "UInt8")
    return (
        f'<VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="{len(points)}" '
        f'NumberOfCells="{len(cells)}"><PointData>{array("U", velocity_of(points), width=3)}</PointData>'
        f"<Points>{array('Points', points, width=3)}</Points><Cells>{lists}</Cells></Piece>"
        "</UnstructuredGrid></VTKFile>"
    )


def cubes() -> list[tuple[int, list[int]]]:
    """Return the hexahedra of the bent box."""
    numbers = np.arange(np.prod(SIDES)).reshape(SIDES[::-1])
    cells, around = [], ((0, 0), (0, 1), (1, 1), (1, 0))
    for k, j, i in np.ndindex(*(count - 1 for count in SIDES[::-1])):
        low, high = numbers[k, j : j + 2, i : i + 2], numbers[k + 1, j : j + 2, i : i + 2]
        cells.append((12, [int(part[at]) for part in (low, high) for at in around]))
    return cells


def cut(cells: list[tuple[int, list[int]]]) -> list[tuple[int, list[int]]]:
    """Return wedges, pyramids, voxels and tetrahedra in place of hexahedra."""
    out = []
    for n, (_, c) in enumerate(cells):
        if n % 3 == 0:
            out += [(13, [c[0], c[1], c[2], c[4], c[5], c[6]]), (13, [c[0], c[2], c[3], c[4], c[6], c[7]])]
        elif n % 3 == 1:
            out += [(14, [c[0], c[1], c[2], c[3], c[4]]), (14, [c[1], c[5], c[6], c[2], c[4]])]
            out += [(10, [c[2], c[6], c[7], c[4]]), (10, [c[2], c[7], c[3], c[4]])]
        else:
            out.append((11, [c[0], c[1], c[3], c[2], c[4], c[5], c[7], c[6]]))
    return out


def read(folder: Path, name: str, text: str, **more: int) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return the nodes (N, 3) of the even grid, their velocities, and notes."""
    path = folder / name
    path.write_text(text)
    samples, _, notes = read_samples((path,), **more)
    nodes = np.stack(np.meshgrid(*samples.axes, indexing="ij"), axis=-1)
    return nodes.reshape(-1, 3), samples.velocities(0).reshape(-1, 3), notes


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.vts", lambda: vts(bent())),
        ("hexahedra.vtu", lambda: vtu(bent(), cubes())),
        ("mixed.vtu", lambda: vtu(bent(), cut(cubes()))),
    ],
)
def test_velocities_between_the_points_are_those_of_the_cells(
    tmp_path: Path, name: str, text: Callable[[], str]
) -> None:
    nodes, velocity, notes = read(tmp_path, name, text(), resolution=24)
    radius, angle = np.hypot(nodes[:, 0], nodes[:, 1]), np.arctan2(nodes[:, 1], nodes[:, 0])
    height = nodes[:, 2] - 0.2 * (radius - 1.0)
    inside = (radius > 1.1) & (radius < 1.9) & (angle > 0.1) & (angle < 1.1) & (height > 0.1) & (height < 0.9)
    assert inside.sum() > 1000
    np.testing.assert_allclose(velocity[inside], velocity_of(nodes[inside]), atol=1e-5)
    assert not velocity[(radius > 2.3) | (radius < 0.7)].any()
    assert "504 points are read on an even grid of 21 × 24 × 16 " in notes[0] and "% (rms)" in notes[0]


def test_flat_data_are_the_same_across_their_plane(tmp_path: Path) -> None:
    points = bent()[: SIDES[0] * SIDES[1]] * [1.0, 1.0, 0.0]
    nodes, velocity, _ = read(tmp_path, "flat.vts", vts(points, (*SIDES[:2], 1)), resolution=20)
    radius, angle = np.hypot(nodes[:, 0], nodes[:, 1]), np.arctan2(nodes[:, 1], nodes[:, 0])
    inside = (radius > 1.1) & (radius < 1.9) & (angle > 0.1) & (angle < 1.1)
    assert len(set(nodes[:, 2])) == 2
    expected = velocity_of(nodes[inside] * [1.0, 1.0, 0.0])
    np.testing.assert_allclose(velocity[inside], expected, atol=1e-5)


def test_a_finer_grid_is_nearer_to_the_points(tmp_path: Path) -> None:
    points = bent()
    text = vts(points, velocity=np.sin(3.0 * points))
    errors = []
    for resolution in (12, 48):
        _, _, notes = read(tmp_path, "a.vts", text, resolution=resolution)
        errors.append(float(notes[0].split("differ by ")[1].split("%")[0]))
    assert errors[1] < errors[0]


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("a.vtu", lambda: vtu(bent(), [(21, [0, 1, 2])]), "cell 0 has VTK's type 21"),
        ("a.vtu", lambda: vtu(bent(), [(10, [0, 1, 2, 9999])]), "a cell names point 9999"),
        ("a.vtu", lambda: vtu(bent(), [(3, [0, 1])]), "no cells with an area or a volume"),
        ("a.vtu", lambda: vtu(bent(), [(5, [0, 1, 100])]), "not in one plane"),
        ("a.vts", lambda: vts(bent()).replace('"U"', '"U" x=""').replace("0 8", "0 9"), "numbers of points"),
        ("a.vts", lambda: vts(bent()).replace("0 8", "0 x"), "must be 6 whole numbers"),
        ("a.vts", lambda: vts(bent(), velocity=np.full((504, 3), np.nan)), "not all finite"),
        ("a.vts", lambda: "<VTKFile type='ImageData'/>", "its type is ImageData"),
    ],
)
def test_what_cannot_be_read_right_is_refused(
    tmp_path: Path, name: str, text: Callable[[], str], fault: str
) -> None:
    with pytest.raises(UsageError, match=fault):
        read(tmp_path, name, text())


def test_a_resolution_that_takes_too_much_memory_is_refused_with_the_largest(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is more than 16,777,216"):
        read(tmp_path, "a.vts", vts(bent()), resolution=60_000)


def test_resolution_is_for_meshes_and_bent_grids(tmp_path: Path) -> None:
    axis = np.linspace(0.0, 1.0, 3)
    np.savez(tmp_path / "a.npz", x=axis, y=axis, z=axis, velocity=np.zeros((3, 3, 3, 3)))
    with pytest.raises(UsageError, match="resolution does not apply"):
        read_samples((tmp_path / "a.npz",), resolution=10)


def test_an_array_of_numbers_goes_the_way_of_the_velocities_and_is_missing_outside(tmp_path: Path) -> None:
    points, slopes = bent(), np.array([1.0, -2.0, 3.0])
    numbers = array("T", points @ slopes + 5.0)
    file = tmp_path / "a.vts"
    file.write_text(vts(points).replace("</PointData>", f"{numbers}</PointData>"))
    velocities = read_samples((file,), None, 1.0, 24).samples
    samples = read_samples((file,), "T", 1.0, 24, is_number=True).samples
    value, known, inside = np.moveaxis(samples.velocities(0), -1, 0)
    assert all(np.array_equal(*axes) for axes in zip(samples.axes, velocities.axes, strict=True))
    nodes = np.stack(np.meshgrid(*samples.axes, indexing="ij"), axis=-1)
    own = np.linalg.norm(nodes[..., :2], axis=-1) - 1.0
    well = (own > 0.1) & (own < 0.9) & (np.abs(nodes[..., 2] - 0.2 * own - 0.5) < 0.4)
    well &= np.abs(np.arctan2(nodes[..., 1], nodes[..., 0]) - 0.6) < 0.5
    assert well.sum() > 500 and (known[well] == 1.0).all() and (inside == 1.0).all()
    np.testing.assert_allclose(value[well], nodes[well] @ slopes + 5.0, atol=1e-5)
    assert not known[(own < -0.2) | (own > 1.2)].any() and not value[known == 0.0].any()
