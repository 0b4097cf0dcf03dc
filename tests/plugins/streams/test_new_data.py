"""`new --data`: shots of velocities in files that preview as they are written."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.shot import read_shot
from tests.conftest import commanded
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("authoring", "fields")


def write_gyre(path: Path, speed: float = 3.0) -> None:
    """Write a box 10 by 6 by 4 about (5, 0, 0) in which all turns about y, faster farther out."""
    x, y, z = np.linspace(0, 10, 11), np.linspace(-3, 3, 7), np.linspace(-2, 2, 5)
    places = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    velocity = speed * np.stack([places[..., 2], np.zeros(places.shape[:3]), 5.0 - places[..., 0]], axis=-1)
    np.savez(path, x=x, y=y, z=z, velocity=velocity)


def write_winds(
    path: Path, west: float = 0.0, east: float = 180.0, land: tuple[float, float] | None = None
) -> None:
    """Write winds of a year between two longitudes, at one level; none between those of `land`."""
    xarray = pytest.importorskip("xarray")
    longitudes, north, months = np.linspace(west, east, 19), np.linspace(-60, 60, 13), np.arange(12.0)
    shape = (12, 13, 19)
    growing = (1.0 + 0.1 * months)[:, None, None]
    wind = np.broadcast_to(8.0 * growing * np.cos(np.radians(north))[None, :, None], shape)
    if land is not None:
        wind = np.where((longitudes >= land[0]) & (longitudes <= land[1]), np.nan, wind)
    names = ("time", "lat", "lon")
    xarray.Dataset(
        {
            "u": (names, wind, {"standard_name": "eastward_wind", "units": "m/s"}),
            "v": (names, 0.2 * wind, {"standard_name": "northward_wind", "units": "m/s"}),
        },
        {
            "time": ("time", 30.0 * months, {"units": "days since 2001-01-15", "standard_name": "time"}),
            "lat": ("lat", north, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", longitudes, {"units": "degrees_east", "standard_name": "longitude"}),
        },
    ).to_netcdf(path, engine="h5netcdf")


def begun(root: Path, data: str, *more: str) -> tuple[int, str]:
    return commanded(root, "new", "A010_sea", "--data", data, *more)


@pytest.mark.parametrize(("name", "pace"), [("gyre.npz", "strength: "), ("winds.nc", 'time_scale: "')])
def test_a_shot_shows_what_velocities_of_a_file_carry_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, pace: str
) -> None:
    (write_gyre if name.endswith("npz") else write_winds)(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, name)
    assert code == 0 and f"{name} stays where it is; the shot names it ../{name}" in said
    text = (tmp_path / "shots/A010_sea.yaml").read_text("utf-8")
    assert pace in text and f'file: "../{name}"' in text
    shot = read_shot(tmp_path / "shots/A010_sea.yaml")
    lines, *bases = shot.parts
    first, *_, last = islice(animate(lines), 40)
    sizes = [np.ptp(frame.mesh.vertices, axis=0).max() for frame in (first, last)]
    assert min(sizes) > 0.5 and max(sizes) < 2.5
    values = last.mesh.attributes["values"][:, 0]
    assert 0.0 < np.median(values) < 20.0
    if name.endswith("npz"):  # 3 times the distance from the axis, as in the file
        assert 11.0 < values.max() < 16.5
    assert np.abs(first.mesh.vertices - last.mesh.vertices[: len(first.mesh.vertices)]).max() > 0.01
    for base in bases:  # data of one level lie on a plate
        assert base.motion.mesh_at_rest().vertices[:, 1].max() < last.mesh.vertices[:, 1].min()


def test_data_around_the_world_lie_on_a_globe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_winds(tmp_path / "winds.nc", 0.0, 350.0)
    monkeypatch.chdir(tmp_path)
    assert begun(tmp_path, "winds.nc")[0] == 0
    lines, globe = read_shot(tmp_path / "shots/A010_sea.yaml").parts
    distances = np.linalg.norm(next(iter(animate(lines))).mesh.vertices, axis=1)
    assert distances.min() > 0.98 and distances.max() < 1.02
    assert np.linalg.norm(globe.motion.mesh_at_rest().vertices, axis=1).max() < 1.0


def test_data_of_one_level_lie_as_a_map_with_north_away_from_the_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_winds(tmp_path / "winds.nc", land=(20.0, 60.0))
    monkeypatch.chdir(tmp_path)
    assert begun(tmp_path, "winds.nc")[0] == 0
    shot = read_shot(tmp_path / "shots/A010_sea.yaml")
    lines, plate = (next(iter(animate(part))).mesh.vertices for part in shot.parts)
    assert np.ptp(lines[:, 1]) < 0.05 < np.ptp(lines[:, 2])
    assert plate[:, 1].max() < lines[:, 1].min()
    picture = iio.imread(tmp_path / "shots/A010_sea_land.png").astype(float).sum(axis=2)
    row = picture[len(picture) // 2]
    assert row[round(0.25 * len(row))] > 2.0 * row[round(0.75 * len(row))]


def write_sea(path: Path, depths: list[float]) -> None:
    """Write a thin sea with land in its west: to the north at the surface, and to the west below it."""
    xarray = pytest.importorskip("xarray")
    east, north = np.linspace(-6, -3, 25), np.linspace(35, 37, 17)
    shape = (2, len(depths), 17, 25)
    is_surface = (np.array(depths) == min(depths))[None, :, None, None]
    land = np.where(east < -5.0, np.nan, 0.0)
    names, units = ("time", "deptht", "lat", "lon"), {"units": "m s-1"}
    speeds = {"uo": np.where(is_surface, 0.0, -0.4) + land, "vo": np.where(is_surface, 0.5, 0.0) + land}
    xarray.Dataset(
        {name: (names, np.broadcast_to(speed, shape), units) for name, speed in speeds.items()},
        {
            "time": ("time", [0.0, 6.0], {"units": "hours since 2024-03-02"}),
            "deptht": ("deptht", depths, {"units": "m", "positive": "down"}),
            "lat": ("lat", north, {"units": "degrees_north"}),
            "lon": ("lon", east, {"units": "degrees_east"}),
        },
    ).to_netcdf(path, engine="h5netcdf")


@pytest.mark.parametrize("depths", [[0.5, 50.0, 400.0], [400.0, 50.0, 0.5]])
def test_a_sea_with_depths_is_a_map_of_its_surface_unless_all_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, depths: list[float]
) -> None:
    write_sea(tmp_path / "sea.nc", depths)
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "sea.nc")
    at = f"at: {{deptht: {depths.index(0.5)}}}"
    assert code == 0 and at in said and "--all-levels" in said
    assert at in (tmp_path / "shots/A010_sea.yaml").read_text("utf-8")
    lines, plate = read_shot(tmp_path / "shots/A010_sea.yaml").parts
    vertices = next(iter(animate(lines))).mesh.vertices
    assert np.ptp(vertices[:, 1]) < 0.05 and plate.motion.mesh_at_rest().vertices[:, 1].max() < 0.0
    field = lines.motion.animated.model.sequence.flow.field
    east, up, south = field.velocity(np.array([[0.3, 0.0, 0.0]]), 0.0)[0]
    assert (east, up) == (0.0, 0.0) and south < 0.0, "north is away from the camera"
    picture = iio.imread(tmp_path / "shots/A010_sea_land.png").astype(float).sum(axis=2)
    row = picture[len(picture) // 2]
    assert row[round(0.2 * len(row))] > 2.0 * row[round(0.7 * len(row))]
    code, said = commanded(tmp_path, "new", "A020_all", "--data", "sea.nc", "--all-levels")
    assert code == 0 and "exaggerate" in (tmp_path / "shots/A020_all.yaml").read_text("utf-8")


def test_layers_of_an_atmosphere_are_raised_and_filled_with_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    xarray = pytest.importorskip("xarray")
    write_winds(tmp_path / "winds.nc")
    with xarray.open_dataset(tmp_path / "winds.nc", engine="h5netcdf", decode_cf=False) as data:
        units = {"units": "m", "standard_name": "height", "positive": "up"}
        heights = ("height", 1000.0 * np.arange(1.0, 12.0), units)
        levels = data.expand_dims(height=11, axis=1).assign_coords(height=heights)
        levels.to_netcdf(tmp_path / "levels.nc", engine="h5netcdf")
    monkeypatch.chdir(tmp_path)
    assert begun(tmp_path, "levels.nc")[0] == 0
    (part,) = read_shot(tmp_path / "shots/A010_sea.yaml").parts
    vertices = next(iter(animate(part))).mesh.vertices
    wide, high, deep = np.ptp(vertices, axis=0)
    assert high > 0.1 * max(wide, deep)
    counts, *_ = np.histogramdd(vertices, bins=(4, 3, 3))
    assert (counts > 0).all(), "there are lines everywhere in the box"


def test_a_sequence_of_files_is_one_shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in (1, 2):
        write_gyre(tmp_path / f"gyre_{number}.npz")
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "gyre_*.npz")
    assert code == 0 and "the shot names it ../gyre_*.npz" in said
    (part,) = read_shot(tmp_path / "shots/A010_sea.yaml").parts
    assert len(next(iter(animate(part))).mesh.vertices) > 100


def test_land_lies_in_a_picture_where_the_globe_shows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_winds(tmp_path / "winds.nc", 0.0, 350.0, land=(20.0, 90.0))
    monkeypatch.chdir(tmp_path)
    assert begun(tmp_path, "winds.nc")[0] == 0
    picture = iio.imread(tmp_path / "shots/A010_sea_land.png").astype(float).sum(axis=2)
    height, width = picture.shape
    row, columns = (
        picture[height // 2],
        [round(width * (0.5 + east / 360.0)) for east in (55.0, -55.0, 130.0)],
    )
    assert row[columns[0]] > 2.0 * row[columns[1]] and row[columns[1]] == row[columns[2]]
    shot = read_shot(tmp_path / "shots/A010_sea.yaml")
    assert any("A010_sea_land.png" in str(file) for file in shot.files)


def test_what_lies_beside_a_turned_grid_is_not_land(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    xarray = pytest.importorskip("xarray")
    east, north = np.meshgrid(np.linspace(-3, 3, 31), np.linspace(-2, 2, 21))
    across, along, names = 0.8 * east - 0.6 * north, 0.6 * east + 0.8 * north, ("y", "x")
    speeds = {
        name: (
            names,
            np.full(east.shape, 0.3),
            {"standard_name": f"{way}_sea_water_velocity", "units": "m/s"},
        )
        for name, way in (("u", "eastward"), ("v", "northward"))
    }
    places = {
        name: (names, values, {"standard_name": name, "units": f"degrees_{side}"})
        for name, values, side in (("longitude", across, "east"), ("latitude", along, "north"))
    }
    xarray.Dataset(speeds, places).to_netcdf(tmp_path / "turned.nc", engine="h5netcdf")
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "turned.nc")
    assert code == 0 and "curvilinear" in said
    assert not (tmp_path / "shots/A010_sea_land.png").exists()


def test_numbers_that_may_mark_what_is_missing_are_remarked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    xarray = pytest.importorskip("xarray")
    write_winds(tmp_path / "winds.nc")
    monkeypatch.chdir(tmp_path)
    with xarray.open_dataset("winds.nc", engine="h5netcdf", decode_cf=False) as data:
        name = next(each for each in data.data_vars if data[each].ndim == 3)
        data.load()[name][:, 2:6, 2:6] = -9999.0
        data.to_netcdf("filled.nc", engine="h5netcdf")
        data.isel(lat=[3]).to_netcdf("row.nc", engine="h5netcdf")
    code, said = begun(tmp_path, "filled.nc")
    assert code == 0 and "such as -999 marks what is missing, name it in _FillValue" in said
    (tmp_path / "shots/A010_sea.yaml").unlink()
    code, said = begun(tmp_path, "row.nc")
    assert code == 2 and "row.nc: its velocities change along one axis alone" in said


def test_data_without_motion_or_beside_other_sources_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "missing.nc")
    assert code == 3 and "missing.nc: file not found; check the path" in said
    write_gyre(tmp_path / "still.npz", speed=0.0)
    code, said = begun(tmp_path, "still.npz")
    assert code == 2 and "still.npz: nothing moves at its first time" in said
    xarray = pytest.importorskip("xarray")
    write_winds(tmp_path / "levels.nc")
    with xarray.open_dataset(tmp_path / "levels.nc", engine="h5netcdf", decode_cf=False) as data:
        level = {"lev": ("lev", np.arange(3.0), {"formula_terms": "s: s eta: zeta depth: h"})}
        data.expand_dims(lev=3).assign_coords(level).to_netcdf(tmp_path / "model.nc", engine="h5netcdf")
    code, said = begun(tmp_path, "model.nc")
    assert code == 2 and said.startswith(f"{tmp_path / 'model.nc'}: coordinate lev counts levels")
    code, said = commanded(tmp_path, "new", "A010_sea", "--all-levels")
    assert code == 2 and "--all-levels is for --data FILE" in said
    code, said = begun(tmp_path, "still.npz", "--sequence", "a_*.ply")
    assert code == 2 and "--data shows files as they are; leave the other options out" in said
    assert not (tmp_path / "shots/A010_sea.yaml").exists()
