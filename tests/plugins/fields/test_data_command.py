"""`flowsculpt data`: what a file holds, and what `sampled` would read of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import commanded

xarray = pytest.importorskip("xarray")


@pytest.fixture
def ocean(tmp_path: Path) -> Path:
    lon, lat = np.arange(0.0, 40.0, 10.0), np.arange(30.0, 50.0, 5.0)
    dims, units = ("time", "lat", "lon"), {"units": "m s-1"}
    u = np.ones((3, 4, 4))
    u[:, 0, 0] = np.nan
    dated = np.arange(3.0)[:, None, None] + (np.arange(4) == 3)  # 1 to 2 at the first time
    data = xarray.Dataset(
        {
            "uo": (dims, u, units),
            "vo": (dims, 0 * u, units),
            "zos": (dims, u + (u == u) * dated, {"units": "m"}),
        },
        {
            "lon": ("lon", lon, {"units": "degrees_east"}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "time": ("time", [0.0, 1.0, 2.0], {"units": "days since 2001-02-29", "calendar": "360_day"}),
        },
    )
    data.to_netcdf(tmp_path / "ocean.nc", engine="h5netcdf")
    return tmp_path / "ocean.nc"


def output_of(*words: str) -> str:
    code, said = commanded(Path(words[0]).parent, "data", *words)
    assert code == 0, said
    return said


def test_variables_axes_and_times_are_listed_with_dates_of_the_calendar(ocean: Path) -> None:
    said = output_of(str(ocean))
    for line in (
        "velocity: {x: uo, y: vo}",
        "x: lon, 0 to 30 degrees, 4 nodes",
        "times: 3, 24 h 00 min apart, 2001-02-29 00:00:00 to 2001-03-01 00:00:00 (360_day)",
        "missing: 6.2% of uo",
        "for colours: values: {variable: zos}, 1 to 2 m at the first time",
        f"a shot of it: flowsculpt new NAME --data {ocean}",
    ):
        assert line in said, said
    assert "zos" in said and "time 3 × lat 4 × lon 4" in said


def test_a_date_that_cannot_be_read_is_reported(ocean: Path) -> None:
    with xarray.open_dataset(ocean, engine="h5netcdf", decode_cf=False) as data:
        data.load().time.attrs["units"] = "days since 2001-02-31"  # of a calendar of 30 days a month
        data.to_netcdf(ocean.parent / "dated.nc", engine="h5netcdf")
    assert "without dates: '2001-02-31' cannot be read (360_day)" in output_of(str(ocean.parent / "dated.nc"))


def test_json_has_the_same_facts(ocean: Path) -> None:
    facts = json.loads(output_of(str(ocean), "--json"))
    assert facts["velocity"] == {"x": "uo", "y": "vo"} and facts["times"]["calendar"] == "360_day"
    assert facts["extents"]["y"] == {"axis": "lat", "from": 30.0, "to": 45.0, "unit": "degrees", "nodes": 4}
    assert facts["missing"]["uo"] == pytest.approx(1 / 16)


def test_depths_are_listed_as_the_file_has_them(ocean: Path) -> None:
    deep = ocean.parent / "deep.nc"
    with xarray.open_dataset(ocean, engine="h5netcdf", decode_cf=False) as data:
        depths = ("depth", [0.0, 10.0, 400.0], {"units": "m", "positive": "down"})
        data.expand_dims(depth=3, axis=1).assign_coords(depth=depths).to_netcdf(deep, engine="h5netcdf")
    assert "z: depth, 0 to 400 m down, 3 nodes" in output_of(str(deep))
    up = json.loads(output_of(str(deep), "--json"))["extents"]["z"]
    assert (up["from"], str(up["to"])) == (-400.0, "0.0")


def test_a_file_without_a_velocity_says_what_it_lacks(ocean: Path) -> None:
    with xarray.open_dataset(ocean, engine="h5netcdf", decode_times=False) as data:
        data.load().drop_vars(["uo", "vo"]).to_netcdf(ocean.parent / "heights.nc", engine="h5netcdf")
    said = output_of(str(ocean.parent / "heights.nc"))
    assert "zos" in said and "no variables are velocities" in said


def test_a_number_that_no_velocity_has_is_reported_below_what_the_file_holds(ocean: Path) -> None:
    with xarray.open_dataset(ocean, engine="h5netcdf", decode_cf=False) as data:
        data.load()["uo"][:, 1, 1] = 1e20
        data.to_netcdf(ocean.parent / "filled.nc", engine="h5netcdf")
    said = output_of(str(ocean.parent / "filled.nc"))
    assert "zos" in said and "samples must be finite" in said and "a shot of it" not in said


def test_sequences_and_their_arrays_are_listed_as_shots_name_them(tmp_path: Path) -> None:
    numbers, places = np.linspace(0, 1, 8), '<DataArray type="Float64" Name="{}" NumberOfComponents="{}">{}'
    arrays = [
        places.format(*each) for each in (("U", 3, "1 0 0 " * 8), ("p", 1, " ".join(map(str, numbers))))
    ]
    text = (
        '<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1" Origin="0 0 0" Spacing="1 1 1">'
        f'<Piece Extent="0 1 0 1 0 1"><PointData>{"</DataArray>".join([*arrays, ""])}</PointData></Piece>'
        "</ImageData></VTKFile>"
    ).replace('">', '" format="ascii">')
    for number in (1, 2, 10):
        (tmp_path / f"wind_{number}.vti").write_text(text, "utf-8")
    said = output_of(str(tmp_path / "wind_*.vti"))
    for line in (
        "velocity: {xyz: U}",
        "times: 3",
        "for colours: values: {variable: p}",
        f"a shot of it: flowsculpt new NAME --data '{tmp_path / 'wind_*.vti'}'",
    ):
        assert line in said, said
    code, said = commanded(tmp_path, "data", str(tmp_path / "waves_*.vti"))
    assert code == 3 and "no file matches" in said


POINTER = f"version https://git-lfs.github.com/spec/v1\noid sha256:{7:064}\nsize 12345\n"


@pytest.mark.parametrize(
    ("name", "content", "exit_code", "remedy"),
    [
        ("a.nc", POINTER, 3, "Run git lfs pull."),
        ("a.abc", POINTER, 3, "Run git lfs pull."),
        ("*.nc", POINTER, 3, "Run git lfs pull."),
        ("a.vti.series", "{}", 2, "Name the files that it lists, as 'NAME_*.vti'"),
        ("a.zarr.zip", "PK", 2, "Unzip it"),
        ("a.zarr", "PK\3\4", 2, "Unzip it"),
        ("wind_$F4.vti", "", 3, "Write wind_*.vti"),
        ("wind_####.vti", "", 3, "Write wind_*.vti"),
        ("absent", "", 3, "file not found"),
        ("absent_*.vti", "", 3, "Correct the name."),
    ],
)
def test_data_and_new_refuse_a_file_with_one_exit_code_and_a_remedy(
    tmp_path: Path, name: str, content: str, exit_code: int, remedy: str
) -> None:
    if content:
        (tmp_path / name.replace("*", "a")).write_text(content)
    for words in (("data",), ("new", "N010_new", "--data")):
        code, said = commanded(tmp_path, *words, str(tmp_path / name))
        assert (code, remedy in " ".join(said.split())) == (exit_code, True), said


def test_velocities_that_are_too_large_are_bad_usage(tmp_path: Path) -> None:
    axis, dims = np.linspace(0.0, 1.0, 4), ("time", "z", "y", "x")
    axes = {name: (name, axis, {"units": "m"}) for name in "xyz"}
    fast = {name: (dims, np.full((2, 4, 4, 4), 1e20), {"units": "m s-1"}) for name in "uvw"}
    times = ("time", [0.0, 1.0], {"units": "seconds since 2000-01-01"})
    xarray.Dataset(fast, {**axes, "time": times}).to_netcdf(tmp_path / "fast.nc", engine="h5netcdf")
    code, said = commanded(tmp_path, "new", "N010_new", "--data", str(tmp_path / "fast.nc"))
    assert code == 2 and "samples must be finite" in said


def test_a_group_that_is_not_there_lists_those_that_are(ocean: Path, tmp_path: Path) -> None:
    with xarray.open_dataset(ocean, engine="h5netcdf", decode_cf=False) as data:
        for name in ("deep/sea", "coast"):
            data.to_netcdf(tmp_path / "groups.nc", engine="h5netcdf", group=name, mode="a")
            data.to_zarr(tmp_path / "groups.zarr", group=name, mode="a", zarr_format=2)
    for file in ("groups.nc", "groups.zarr"):
        code, said = commanded(tmp_path, "data", str(tmp_path / file), "--group", "coats")
        assert code == 2 and "it has no group coats. There are: coast, deep/sea." in " ".join(said.split())
    code, said = commanded(tmp_path, "data", str(ocean), "--group", "coast")
    assert code == 2 and "it has no group coast. Leave out group." in " ".join(said.split())


def test_grids_of_arrays_are_listed_too(tmp_path: Path) -> None:
    axis = np.linspace(-1.0, 1.0, 3)
    np.savez(tmp_path / "a.npz", x=axis, y=axis, z=axis, velocity=np.zeros((3, 3, 3, 3)))
    said = output_of(str(tmp_path / "a.npz"))
    assert "x: x, -1 to 1, 3 nodes" in said and "new NAME --data" in said
