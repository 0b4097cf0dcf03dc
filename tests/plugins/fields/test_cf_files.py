"""Fields in NetCDF, HDF5 and Zarr by the CF conventions: each is read right, or refused in one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FlowsculptError, UsageError
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.plugins.fields.cf_conventions import duration, speed_factor, velocity_direction
from flowsculpt.pipeline.plugins.fields.cf_files import cf_samples
from flowsculpt.pipeline.plugins.fields.cf_headers import Selection
from flowsculpt.pipeline.plugins.fields.grid_layout import EARTH, Placing

xarray = pytest.importorskip("xarray")

LON, LAT = np.arange(10.0, 14.5, 0.5), np.arange(50.0, 53.5, 0.5)
TIMES = np.arange(3.0)
EAST = {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}
NORTH = {"standard_name": "northward_sea_water_velocity", "units": "m s-1"}
LONGITUDE, LATITUDE = {"units": "degrees_east"}, {"units": "degrees_north"}
HOURS = {"units": "hours since 2020-02-28 00:00:00", "calendar": "standard"}


def dataset(**changes: Any) -> Any:
    """Return a field whose velocity at (time, latitude, longitude) is (time + lat − 50, lon − 10) m/s."""
    lon, lat, times = (
        np.asarray(changes.get(k, v)) for k, v in (("lon", LON), ("lat", LAT), ("time", TIMES))
    )
    t, n, e = np.meshgrid(np.arange(len(times)), lat - 50.0, lon - 10.0, indexing="ij")
    dims = ("time", "lat", "lon")
    return xarray.Dataset(
        {
            "uo": (dims, (t + n).astype("f4"), changes.get("east", EAST)),
            "vo": (dims, e.astype("f4"), changes.get("north", NORTH)),
        },
        {
            "lon": ("lon", lon, changes.get("longitude", LONGITUDE)),
            "lat": ("lat", lat, changes.get("latitude", LATITUDE)),
            "time": ("time", times, changes.get("hours", HOURS)),
        },
    )


def save(data: Any, file: Path, **more: Any) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if file.suffix == ".zarr":
            data.to_zarr(file, mode="w", **more)
        else:
            data.to_netcdf(file, engine=more.pop("engine", "h5netcdf"), **more)
    return file


def velocity_at(
    samples: Any, lon: float, lat: float, index: int = 0, height: float | None = None
) -> np.ndarray:
    """Return the velocity at the node nearest to a place of a plane in degrees, m/s."""
    header = samples.headers[0].coordinates
    i = int(np.argmin(np.abs((header.east - lon + 180.0) % 360.0 - 180.0)))
    j = int(np.argmin(np.abs(header.north - lat)))
    k = 0 if height is None else int(np.argmin(np.abs(header.up - height)))
    velocity = samples.velocities(index)
    return velocity[i, k, -1 - j] if samples.layout.is_upright else velocity[i, j, k]


def read(data: Any, folder: Path, placing: Placing = Placing(), **selection: Any) -> Any:  # noqa: B008
    return cf_samples((save(data, folder / "a.nc"),), Selection(**selection), placing)[0]


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("a.nc", {}),
        ("three.nc", {"engine": "scipy"}),
        ("classic.nc", {"engine": "scipy", "format": "NETCDF3_CLASSIC"}),
        ("b.h5", {}),
        ("two.zarr", {"zarr_format": 2}),
        ("three.zarr", {"zarr_format": 3}),
        ("loose.zarr", {"zarr_format": 2, "consolidated": False}),
    ],
)
def test_a_field_of_any_format_has_the_velocities_that_were_written(
    tmp_path: Path, name: str, more: dict[str, Any]
) -> None:
    samples, _ = cf_samples((save(dataset(), tmp_path / name, **more),), Selection(), Placing())
    assert samples.times.tolist() == [0.0, 3600.0, 7200.0]
    north = np.cos(np.radians(51.5)) / np.cos(np.radians(52.0))  # degrees of longitude are narrower there
    np.testing.assert_allclose(velocity_at(samples, 11.0, 52.0, 1), [3.0 * north, 1.0, 0.0], rtol=1e-6)
    assert np.ptp(samples.axes[1]) == pytest.approx(EARTH * np.radians(3.0))


SAME: dict[str, Callable[[Any], Any]] = {
    "latitudes that descend": lambda d: d.isel(lat=slice(None, None, -1)),
    "longitudes that descend": lambda d: d.isel(lon=slice(None, None, -1)),
    "dimensions in another order": lambda d: d.transpose("lon", "time", "lat"),
    "components in different orders": lambda d: d.assign(vo=d.vo.transpose("lat", "lon", "time")),
    "longitudes from 0 to 360": lambda d: d.assign_coords(lon=("lon", (d.lon.values + 360) % 360, LONGITUDE)),
    "big-endian numbers": lambda d: d.assign(uo=d.uo.astype(">f4"), vo=d.vo.astype(">f8")),
    "double precision": lambda d: d.astype("f8", keep_attrs=True),
    "a scalar coordinate": lambda d: d.assign_coords(depth=((), 0.5, {"units": "m", "positive": "down"})),
    "a depth of one": lambda d: d.expand_dims(depth=[0.5], axis=1),
    "bounds": lambda d: d.assign(lat_bnds=(("lat", "two"), np.zeros((7, 2)))),
    "texts": lambda d: d.assign(station=("name", np.array(["a", "bc"]))),
    "other variables": lambda d: d.assign(thetao=(("time", "lat", "lon"), np.zeros((3, 7, 9)))),
    "names in other words": lambda d: d.rename(lon="x", lat="y", uo="a", vo="b"),
    "an unlimited time": lambda d: d.assign_attrs(x=1),
    "units by their names": lambda d: d.assign(uo=d.uo.assign_attrs(units="meter second-1")),
}


@pytest.mark.parametrize("what", SAME)
def test_how_a_file_is_arranged_changes_no_velocity(tmp_path: Path, what: str) -> None:
    samples = read(SAME[what](dataset()), tmp_path)
    factor = np.cos(np.radians(51.5)) / np.cos(np.radians(52.0))
    np.testing.assert_allclose(velocity_at(samples, 11.0, 52.0, 2), [4.0 * factor, 1.0, 0.0], rtol=1e-5)


def packed(data: Any) -> Any:
    for name in ("uo", "vo"):
        data[name].encoding = {"dtype": "i2", "scale_factor": 0.001, "add_offset": 2.0, "_FillValue": -32768}
    data["uo"][:, 4, 2] = np.nan
    return data


def test_packed_shorts_are_scaled_and_fill_values_are_land(tmp_path: Path) -> None:
    samples = read(packed(dataset()), tmp_path)
    assert not velocity_at(samples, 11.0, 52.0).any()
    factor = np.cos(np.radians(51.5)) / np.cos(np.radians(52.5))
    np.testing.assert_allclose(velocity_at(samples, 11.5, 52.5), [2.5 * factor, 1.5, 0.0], atol=1e-3)


def test_missing_numbers_stop_what_is_there(tmp_path: Path) -> None:
    data = dataset()
    data["uo"][:, 4, 2] = np.nan
    data["vo"][:, 5, 3] = 9.96921e36
    data["vo"].attrs["valid_max"] = np.float32(3.4)
    samples = read(data, tmp_path)
    for place in ((11.0, 52.0), (11.5, 52.5), (14.0, 51.0)):
        assert not velocity_at(samples, *place).any(), place


def test_ends_of_valid_numbers_are_unpacked_where_they_are_floats(tmp_path: Path) -> None:
    data = packed(dataset())
    expected = read(data, tmp_path).velocities(0)
    for name in ("uo", "vo"):  # of packed numbers from -2000 to 3000
        data[name].attrs["valid_range"] = np.array([-1.0, 5.0], "f4")
    np.testing.assert_array_equal(read(data, tmp_path).velocities(0), expected)
    data["vo"].attrs["valid_range"] = np.array([-1000, 1000], "i2")
    samples = read(data, tmp_path)
    assert velocity_at(samples, 12.0, 51.5).any() and not velocity_at(samples, 13.5, 51.5).any()
    data["vo"].attrs["valid_range"] = np.array([1.0])
    with pytest.raises(UsageError, match="valid_range without numbers"):
        read(data, tmp_path).velocities(0)


@pytest.mark.parametrize("fill", [-999.9, 1e20])
def test_a_fill_value_in_double_precision_is_that_of_floats(tmp_path: Path, fill: float) -> None:
    data = dataset()
    for name in ("uo", "vo"):
        data[name][:, 4, 2] = fill
        data[name].attrs["missing_value"] = np.float64(fill)
    assert not velocity_at(read(data, tmp_path), 11.0, 52.0).any()


def test_a_velocity_of_0_is_there_though_zarr_fills_with_0(tmp_path: Path) -> None:
    data = dataset()
    data["uo"].encoding = data["vo"].encoding = {"_FillValue": 0.0}
    samples, _ = cf_samples((save(data, tmp_path / "a.zarr", zarr_format=2),), Selection(), Placing())
    np.testing.assert_allclose(velocity_at(samples, 11.0, 50.0, 0), [0.0, 1.0, 0.0], rtol=1e-6)


def test_at_land_that_slides_velocities_go_along_the_coast(tmp_path: Path) -> None:
    data = dataset()
    data["uo"][:], data["vo"][:] = 1.0, 1.0
    data["uo"][:, :, 6:] = np.nan  # a coast along a meridian
    samples = read(data, tmp_path, Placing(land="slide"))
    beside, inland = velocity_at(samples, 13.0, 51.5), velocity_at(samples, 14.0, 51.5)
    np.testing.assert_allclose(beside, [0.0, 1.0, 0.0], atol=1e-6)
    assert not inland.any() and not velocity_at(read(data, tmp_path), 13.0, 51.5).any()


@pytest.mark.parametrize(
    ("units", "calendar", "seconds"),
    [
        ("days since 1950-01-01", "standard", 86400.0),
        ("days since 2000-02-30", "360_day", 86400.0),
        ("days since 0001-01-01", "noleap", 86400.0),
        ("minutes since 1970-01-01T00:00:00Z", "proleptic_gregorian", 60.0),
        ("seconds since 1900-01-01 00:00:0.0", "gregorian", 1.0),
        ("months since 2000-01-01", "360_day", 30 * 86400.0),
        ("h", "", 3600.0),
    ],
)
def test_times_are_seconds_after_the_first_one(
    tmp_path: Path, units: str, calendar: str, seconds: float
) -> None:
    data = dataset(hours={"units": units, "calendar": calendar}, time=np.array([100.0, 101.0, 103.0]))
    assert read(data, tmp_path).times.tolist() == [0.0, seconds, 3.0 * seconds]


MID_MONTHS = [15.5, 45.0, 74.5, 105.0, 135.5, 166.0, 196.5, 227.5, 258.0, 288.5, 319.0, 349.5]


@pytest.mark.parametrize(
    ("units", "calendar", "times", "days"),
    [
        ("days since 2001-01-01", "noleap", MID_MONTHS, 365.0),
        ("days since 2001-01-01", "standard", MID_MONTHS, 365.2425),
        ("days since 2001-01-01", "standard", [*MID_MONTHS, 380.5], 365.0),
        ("days since 2001-01-01", "360_day", np.arange(15.0, 360.0, 30.0), 360.0),
        ("days since 2003-01-01", "noleap", np.arange(365.0), 365.0),
        ("hours since 2001-01-01", "standard", np.arange(0.0, 24.0, 3.0), 1.0),
        ("days since 2001-01-01", "standard", [0.0, 1.0, 2.0, 3.0], 3.0),
    ],
)
def test_months_repeat_after_a_year_and_hours_after_a_day(
    tmp_path: Path, units: str, calendar: str, times: Any, days: float
) -> None:
    data = dataset(hours={"units": units, "calendar": calendar}, time=np.array(times))
    samples = read(data, tmp_path)
    assert samples.period == pytest.approx(days * 86400.0)
    flow, last = Sampled(samples, loop=True), float(samples.times[-1])
    for share in (0.25, 0.75) if samples.period > last else ():
        later = last + share * (samples.period - last)
        assert flow.moment(later) == (len(times) - 1, 0, pytest.approx(share))
        assert flow.moment(later + samples.period) == (len(times) - 1, 0, pytest.approx(share))
        assert flow.seconds(later) == pytest.approx(later)
    assert flow.moment(samples.period + 0.5 * samples.times[1]) == (0, 1, pytest.approx(0.5))


def test_means_over_years_that_fill_no_year_do_not_loop(tmp_path: Path) -> None:
    hours = {"units": "days since 2001-01-01", "calendar": "standard", "climatology": "bounds"}
    samples = read(dataset(hours=hours, time=np.array(MID_MONTHS[:5])), tmp_path)
    with pytest.raises(UsageError, match="do not fill one evenly, so loop cannot join them"):
        Sampled(samples, loop=True).moment(0.0)
    assert Sampled(samples).moment(1e9) == (4, 4, 0.0)


def test_files_after_one_another_may_count_from_other_dates(tmp_path: Path) -> None:
    first = save(dataset(), tmp_path / "ocean_1.nc")
    hours = {"units": "days since 2020-02-29", "calendar": "standard"}  # of a leap year
    second = save(dataset(hours=hours), tmp_path / "ocean_2.nc")
    samples, _ = cf_samples((first, second), Selection(), Placing())
    assert samples.times.tolist() == [0.0, 3600.0, 7200.0, 86400.0, 2 * 86400.0, 3 * 86400.0]
    np.testing.assert_array_equal(samples.velocities(4), samples.velocities(1))
    with pytest.raises(
        UsageError, match=r"ocean_1\.nc: its first time is not after the last one of ocean_2\.nc"
    ):
        cf_samples((second, first), Selection(), Placing())
    other = save(dataset(lat=LAT + 1.0), tmp_path / "other.nc")
    with pytest.raises(UsageError, match="all files of a sequence share one grid"):
        cf_samples((first, other), Selection(), Placing())


def test_components_may_be_in_files_of_their_own(tmp_path: Path) -> None:
    whole = dataset()
    first, second = (save(whole[[name]], tmp_path / f"{name}.nc") for name in ("uo", "vo"))
    samples, _ = cf_samples((first,), Selection(), Placing(), (second,))
    known, _ = cf_samples((save(whole, tmp_path / "a.nc"),), Selection(), Placing())
    np.testing.assert_array_equal(samples.velocities(1), known.velocities(1))
    assert [path.name for path, _ in samples.files(0)] == ["uo.nc", "vo.nc"]
    other = save(dataset(time=TIMES + 1.0)[["vo"]], tmp_path / "b.nc")
    with pytest.raises(UsageError, match=r"b\.nc: its axis time differs from that of uo\.nc"):
        cf_samples((first,), Selection(), Placing(), (other,))


def globe(step: float = 5.0, first: float = 0.0, poles: bool = True) -> Any:
    """Return a solid turn about the axis of the earth, and one about the x axis: smooth at the poles."""
    lon, edge = first + np.arange(0.0, 360.0, step), 90.0 if poles else 90.0 - step / 2
    lat = np.linspace(-edge, edge, round(2 * edge / step) + 1)
    e, n = np.meshgrid(np.radians(lon), np.radians(lat))
    u = 40.0 * np.cos(n) + 20.0 * np.sin(n) * np.sin(e)
    v = 20.0 * np.cos(e)
    dims = ("lat", "lon")
    return xarray.Dataset(
        {"u": (dims, u, {"units": "m/s"}), "v": (dims, v, {"units": "m/s"})},
        {"lon": ("lon", lon % 360.0, LONGITUDE), "lat": ("lat", lat, LATITUDE)},
    )


@pytest.mark.parametrize("poles", [True, False], ids=["with poles", "without poles"])
@pytest.mark.parametrize("first", [0.0, 180.0], ids=["from 0", "across the seam"])
def test_on_a_sphere_velocities_are_smooth_at_the_seam_and_the_poles(
    tmp_path: Path, first: float, poles: bool
) -> None:
    field = Sampled(read(globe(2.0, first, poles), tmp_path, Placing("sphere")), "cubic")
    generator = np.random.default_rng(3)
    points = generator.normal(size=(4000, 3))
    points[:50] = [0.01, 1.0, 0.01] * generator.normal(size=(50, 3))  # at the poles
    points[50:100, 0] *= 1e-3
    points /= np.linalg.norm(points, axis=1)[:, None]
    x, y, z = points.T
    lat, lon = np.arcsin(y), np.arctan2(x, z)
    u = 40.0 * np.cos(lat) + 20.0 * np.sin(lat) * np.sin(lon)
    v = 20.0 * np.cos(lon)
    east = np.stack([np.cos(lon), 0 * lon, -np.sin(lon)], 1)
    north = np.stack([-np.sin(lat) * np.sin(lon), np.cos(lat), -np.sin(lat) * np.cos(lon)], 1)
    expected = (u[:, None] * east + v[:, None] * north) / EARTH
    found = field.velocity(points, 0.0)
    assert np.abs(found - expected).max() * EARTH < 0.05, "m/s of 40"
    assert np.abs(np.sum(found * points, axis=1)).max() * EARTH < 1e-5, "along the sphere"
    near = points + 1e-4 * generator.normal(size=points.shape)
    slope = np.linalg.norm(field.velocity(near, 0.0) - found, axis=1) / np.linalg.norm(near - points, axis=1)
    assert slope.max() <= 1.05 * field.gradient_bound(0.0)


def test_heights_stand_up_and_are_exaggerated(tmp_path: Path) -> None:
    data = dataset().isel(time=0).expand_dims(depth=[0.0, 10.0, 50.0]).copy()
    data["depth"].attrs = {"units": "m", "positive": "down", "axis": "Z"}
    data["wo"] = (("depth", "lat", "lon"), np.full((3, 7, 9), 0.001), {"units": "m s-1"})
    data["wo"].attrs["standard_name"] = "upward_sea_water_velocity"
    samples = read(data, tmp_path, Placing(exaggerate=100.0))
    np.testing.assert_allclose(samples.axes[1], [-5000.0, -1000.0, 0.0])
    np.testing.assert_allclose(velocity_at(samples, 11.0, 51.5, height=-10.0), [1.5, 0.1, -1.0], rtol=1e-5)
    flat = read(data, tmp_path, Placing(up="y"))
    assert np.ptp(flat.axes[2]) == 50.0
    section = read(data, tmp_path, at=(("lat", 3),))
    surface = read(data, tmp_path, at=(("depth", 0),))
    np.testing.assert_allclose(velocity_at(surface, 11.0, 51.5), [1.5, 0.001, -1.0], rtol=1e-5)  # north: -z
    assert surface.surface is None and samples.surface == ("depth", 0)
    assert surface.digest(0) != read(data, tmp_path, Placing(up="y"), at=(("depth", 0),)).digest(0)
    assert np.ptp(section.axes[2]) > 1e6 and section.velocities(0).shape == (9, 3, 2, 3)


def test_numbers_below_0_of_an_axis_of_depths_go_down_and_a_note_says_so(tmp_path: Path) -> None:
    data = dataset().isel(time=0).expand_dims(Z=[-5.0, -15.0, -30.0]).copy()
    data["Z"].attrs = {"units": "m", "positive": "down", "standard_name": "depth"}  # as MITgcm writes it
    samples, notes = cf_samples((save(data, tmp_path / "a.nc"),), Selection(), Placing())
    np.testing.assert_allclose(samples.axes[1], [-30.0, -15.0, -5.0])
    assert samples.surface == ("Z", 0) and any("numbers below 0 go down too" in note for note in notes)


def test_pressures_are_heights_of_the_standard_atmosphere(tmp_path: Path) -> None:
    data = dataset().isel(time=0).expand_dims(plev=[100000.0, 50000.0, 10000.0]).copy()
    data["plev"].attrs = {"units": "Pa", "standard_name": "air_pressure"}
    data["w"] = data["uo"].assign_attrs(standard_name="lagrangian_tendency_of_air_pressure", units="Pa s-1")
    samples, notes = cf_samples((save(data, tmp_path / "a.nc"),), Selection(), Placing())
    np.testing.assert_allclose(samples.axes[1], [110.9, 5574.4, 16180.0], rtol=2e-3)
    assert any("standard atmosphere" in note for note in notes)


def test_a_plane_may_be_fitted_and_degrees_per_second_are_turned_into_its_units(tmp_path: Path) -> None:
    samples = read(dataset(), tmp_path, Placing(fit=4.0))
    assert max(float(np.ptp(axis)) for axis in samples.axes[:2]) == pytest.approx(4.0)
    assert samples.axes[0].mean() == pytest.approx(0.0, abs=1e-12)
    degrees = {"units": "degrees s-1"}
    angular = read(dataset(east=EAST | degrees, north=NORTH | degrees), tmp_path)
    metres = EARTH * np.radians(1.0)
    narrow = np.cos(np.radians(51.5))
    np.testing.assert_allclose(
        velocity_at(angular, 11.0, 52.0), [2.0 * metres * narrow, metres, 0.0], rtol=1e-5
    )


def test_axes_in_kilometres_are_a_plane_as_they_are(tmp_path: Path) -> None:
    data = dataset(longitude={"units": "km", "axis": "X"}, latitude={"units": "km", "axis": "Y"})
    samples = read(data, tmp_path)
    np.testing.assert_allclose(samples.axes[0], 1000.0 * LON)
    np.testing.assert_allclose(samples.velocities(0)[2, 4, 0], [2.0, 1.0, 0.0])
    with pytest.raises(
        UsageError, match="not longitude and latitude in degrees, so it does not fit a sphere"
    ):
        read(data, tmp_path, Placing("sphere"))


def test_missing_units_are_noted(tmp_path: Path) -> None:
    data = dataset(east={"standard_name": EAST["standard_name"]}, longitude={}, latitude={})
    _, notes = cf_samples((save(data, tmp_path / "a.nc"),), Selection(), Placing())
    assert any("uo has no units; it is taken as m/s" in note for note in notes)
    assert any("lon has no units; it is taken as degrees" in note for note in notes)


def test_variables_groups_and_members_can_be_named(tmp_path: Path) -> None:
    data = dataset().expand_dims(number=[0, 1]).copy(deep=True)
    data["uo"] = data["uo"] + xarray.DataArray([0.0, 5.5], dims="number")
    data["uo"].attrs = EAST
    file = save(data, tmp_path / "a.nc", group="run/b")
    with pytest.raises(UsageError, match="write group: run/b"):
        cf_samples((file,), Selection(), Placing())
    chosen = Selection((("x", "uo"), ("y", "vo")), (("number", 1),), "run/b")
    samples, _ = cf_samples((file,), chosen, Placing(up="y"))
    assert velocity_at(samples, 12.0, 51.5)[0] == pytest.approx(7.0)


def test_groups_of_a_zarr_store_are_named_where_the_first_has_no_variables(tmp_path: Path) -> None:
    store = save(dataset(), tmp_path / "a.zarr", group="ocean/daily")
    with pytest.raises(UsageError, match="and others have: ocean/daily; write group: ocean/daily"):
        cf_samples((store,), Selection(), Placing())
    samples, _ = cf_samples((store,), Selection(group="ocean/daily"), Placing())
    assert samples.times.tolist() == [0.0, 3600.0, 7200.0]


def curvilinear(data: Any) -> Any:
    two = np.meshgrid(LON, LAT)
    dims = ("y", "x")
    data = data.rename(lat="y", lon="x").drop_vars(["x", "y"])
    data["lon"] = (dims, two[0], {"standard_name": "longitude", "units": "degrees_east"})
    data["lat"] = (dims, two[1], {"standard_name": "latitude", "units": "degrees_north"})
    return data.set_coords(["lon", "lat"])


def unstructured(data: Any) -> Any:
    data = data.stack(node=("lat", "lon")).drop_vars(["node", "lat", "lon"])
    data["lon"] = ("node", np.tile(LON, 7), {"standard_name": "longitude"})
    data["lat"] = ("node", np.repeat(LAT, 9), {"standard_name": "latitude"})
    return data


def staggered(data: Any) -> Any:
    west = data["uo"].assign_coords(lon=LON - 0.25).rename(lon="lon_u")
    west["lon_u"].attrs = LONGITUDE
    return data.assign(uo=west.drop_vars("lon_u").assign_coords(lon_u=("lon_u", LON - 0.25, LONGITUDE)))


def bent(along: str = "eastward", around: bool = False) -> Any:
    """Return a field on a grid that is turned by 25 degrees, or goes around the globe.

    Its velocity goes east by sin(4 latitude) and north by cos(2 longitude).
    """
    j, i = np.meshgrid(np.linspace(0.0, 1.0, 50), np.linspace(0.0, 1.0, 60), indexing="ij")
    x, y, turn = 20.0 * i - 10.0, 16.0 * j - 8.0, np.radians(25.0)
    lon, lat = 180.0 + x * np.cos(turn) - y * np.sin(turn), 40.0 + x * np.sin(turn) + y * np.cos(turn)
    if around:
        lon, lat = 360.0 * i * 60 / 61 + 10.0 * np.sin(np.pi * j), 140.0 * j - 70.0
    lon = (lon + 180.0) % 360.0 - 180.0  # jumps within the grid
    east, north = np.sin(np.radians(4.0 * lat)), np.cos(np.radians(2.0 * lon))
    names = ["eastward_sea_water_velocity", "northward_sea_water_velocity"]
    if along == "grid":
        names = ["sea_water_x_velocity", "sea_water_y_velocity"]
        step = np.gradient(np.unwrap(lon, period=360.0, axis=1), axis=1) * np.cos(np.radians(lat))
        angle = np.arctan2(np.gradient(lat, axis=1), step)
        east, north = (
            east * np.cos(angle) + north * np.sin(angle),
            north * np.cos(angle) - east * np.sin(angle),
        )
    times = 1.0 + np.arange(2.0)[:, None, None]
    fields = {
        name: (
            ("time", "y", "x"),
            (times * values).astype("f4"),
            {"units": "m s-1", "standard_name": standard},
        )
        for name, values, standard in zip(("uo", "vo"), (east, north), names, strict=True)
    }
    places = {"nav_lon": (("y", "x"), lon, LONGITUDE), "nav_lat": (("y", "x"), lat, LATITUDE)}
    return xarray.Dataset(fields, places | {"time": ("time", np.arange(2.0), HOURS)})


@pytest.mark.parametrize(
    ("along", "around", "most"), [("eastward", False, 1e-3), ("grid", False, 1e-3), ("eastward", True, 0.01)]
)
def test_curvilinear_grids_are_read_on_even_ones(
    tmp_path: Path, along: str, around: bool, most: float
) -> None:
    samples = read(bent(along, around), tmp_path)
    for lon, lat in ((179.0, 40.0), (-178.0, 38.0), (175.0, 41.0)):
        here = samples.headers[0].coordinates
        near = here.east[np.argmin(np.abs((here.east - lon + 180.0) % 360.0 - 180.0))]
        level = here.north[np.argmin(np.abs(here.north - lat))]
        wider = np.cos(np.radians(0.5 * (here.north[0] + here.north[-1]))) / np.cos(np.radians(level))
        east, north, _ = velocity_at(samples, lon, lat, 1)
        assert east / wider == pytest.approx(2.0 * np.sin(np.radians(4.0 * level)), abs=most)
        assert north == pytest.approx(2.0 * np.cos(np.radians(2.0 * near)), abs=most)
    assert here.is_global == around


def test_a_curvilinear_grid_is_read_with_its_error_and_land_stays_land(tmp_path: Path) -> None:
    data = bent()
    data["uo"] = data.uo.where((data.nav_lat < 40.0) | (data.nav_lat > 44.0))
    path = save(data, tmp_path / "a.nc")
    samples, notes = cf_samples((path,), Selection(resolution=80), Placing())
    assert any("60 × 50 nodes is read on an even one of 80 ×" in note and "% (rms)" in note for note in notes)
    assert not velocity_at(samples, 180.0, 42.0).any()
    assert velocity_at(samples, 180.0, 38.0).any()
    assert not velocity_at(samples, 170.0, 30.5).any()  # outside of the grid


def test_along_settles_what_names_leave_open(tmp_path: Path) -> None:
    data = bent("grid")
    for name in ("uo", "vo"):
        del data[name].attrs["standard_name"]
    with pytest.raises(UsageError, match="Write along: east, or along: grid"):
        read(data, tmp_path)
    known = read(bent("grid"), tmp_path).velocities(0)
    assert np.array_equal(known, read(data, tmp_path, along="grid").velocities(0))


def test_resolution_and_along_are_for_curvilinear_grids(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="are for curvilinear grids"):
        read(dataset(), tmp_path, resolution=100)


@pytest.mark.parametrize(
    ("date", "seconds"), [("2020-02-28", 0.0), ("2020-02-28T01:30", 5400.0), ("2020-02-28 02:00:00", 7200.0)]
)
def test_a_date_is_seconds_after_the_first_time(tmp_path: Path, date: str, seconds: float) -> None:
    assert read(dataset(), tmp_path).seconds_of(date) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("hours", "date", "fault"),
    [
        (HOURS, "2020-02-29", "its times are 2020-02-28 00:00:00 to 2020-02-28 02:00:00"),
        (HOURS | {"calendar": "noleap"}, "2020-02-29", "is not a date of its calendar, noleap"),
        ({"units": "hours"}, "2020-02-28", "have no dates"),
    ],
)
def test_dates_that_the_data_lack_are_refused(tmp_path: Path, hours: Any, date: str, fault: str) -> None:
    with pytest.raises(UsageError, match=fault):
        read(dataset(hours=hours), tmp_path).seconds_of(date)


WRONG: dict[str, tuple[Callable[[Any], Any], str]] = {
    "no velocity": (
        lambda d: d.assign(thetao=d.uo.assign_attrs(standard_name="")).drop_vars(["uo", "vo"]),
        "no variables are velocities by standard_name",
    ),
    "two velocities": (
        lambda d: d.assign(
            ugos=d.uo.assign_attrs(standard_name="surface_geostrophic_eastward_sea_water_velocity"),
            vgos=d.vo.assign_attrs(standard_name="surface_geostrophic_northward_sea_water_velocity"),
        ),
        "there are 2 velocities in it",
    ),
    "units of a temperature": (
        lambda d: d.assign(uo=d.uo.assign_attrs(units="K")),
        "'K' are not units of a velocity",
    ),
    "units that are mixed": (
        lambda d: d.assign(uo=d.uo.assign_attrs(units="degrees s-1")),
        "some of its components are in m/s and others in degrees/s",
    ),
    "a curvilinear grid with components along nothing known": (
        lambda d: curvilinear(d.assign({k: d[k].assign_attrs(standard_name="") for k in ("uo", "vo")})),
        "nothing says whether it goes east",
    ),
    "a curvilinear grid with one row": (
        lambda d: curvilinear(d).isel(y=slice(1)),
        "has one row",
    ),
    "an unstructured mesh": (unstructured, "on an unstructured mesh"),
    "a staggered grid": (staggered, "as on a staggered grid"),
    "no times": (lambda d: d.isel(time=slice(0)), "time has a length of 0"),
    "a time that comes twice": (
        lambda d: d.assign_coords(time=("time", [0.0, 1.0, 1.0], HOURS)),
        "times 2 and 3 .* are the same",
    ),
    "times that go back": (
        lambda d: d.assign_coords(time=("time", [0.0, 2.0, 1.0], HOURS)),
        "are in the wrong order",
    ),
    "times without units": (
        lambda d: d.assign_coords(time=("time", TIMES, {"axis": "T"})),
        "times have no units",
    ),
    "times in months": (
        lambda d: d.assign_coords(time=("time", TIMES, {"units": "months since 2000-01-01"})),
        "whose length changes in calendar standard",
    ),
    "an unknown calendar": (
        lambda d: d.assign_coords(time=("time", TIMES, HOURS | {"calendar": "mayan"})),
        "calendar 'mayan' is unknown",
    ),
    "a missing time": (
        lambda d: d.assign_coords(time=("time", [0.0, np.nan, 2.0], HOURS)),
        "coordinate time has missing values",
    ),
    "a latitude beyond the pole": (
        lambda d: d.assign_coords(lat=("lat", LAT + 40, LATITUDE)),
        "latitude 93 is beyond",
    ),
    "an axis in kelvins": (
        lambda d: d.assign_coords(lat=("lat", LAT, {"units": "K", "axis": "Y"})),
        "has the units 'K'; an axis in space",
    ),
    "an axis out of order": (
        lambda d: d.assign_coords(lat=("lat", LAT[[0, 2, 1, 3, 4, 5, 6]], LATITUDE)),
        "neither ascends nor descends",
    ),
    "a row that comes twice": (
        lambda d: d.assign_coords(lat=("lat", np.r_[LAT[0], LAT[:-1]], LATITUDE)),
        "remove values that come twice",
    ),
    "axes in degrees and metres": (
        lambda d: d.assign_coords(lat=("lat", LAT, {"units": "m", "axis": "Y"})),
        "have different units",
    ),
    "members": (lambda d: d.expand_dims(member=4), r"at: \{member: 0\}"),
    "a level of a model": (
        lambda d: d.expand_dims(lev=np.arange(3.0)).assign_coords(
            lev=("lev", np.arange(3.0), {"standard_name": "atmosphere_sigma_coordinate", "axis": "Z"})
        ),
        "counts levels",
    ),
    "levels of an ocean model that say that they are an axis": (
        lambda d: d.expand_dims(s=np.arange(-2.0, 1.0)).assign_coords(
            s=("s", np.arange(-2.0, 1.0), {"standard_name": "ocean_s_coordinate_g2", "axis": "Z"})
        ),
        "coordinate s counts levels",
    ),
    "levels whose heights a formula gives": (
        lambda d: d.expand_dims(s=np.arange(-2.0, 1.0)).assign_coords(
            s=("s", np.arange(-2.0, 1.0), {"formula_terms": "s: s eta: zeta depth: h"})
        ),
        "coordinate s counts levels",
    ),
    "a scale that is a text": (
        lambda d: d.assign(uo=d.uo.assign_attrs(scale_factor="one")),
        "attribute scale_factor of uo is 'one'",
    ),
    "a component that is text": (
        lambda d: d.assign(uo=(d.vo.dims, np.full(d.vo.shape, "a", "S1"), EAST)),
        "no variables are velocities",
    ),
    "dimensions that differ": (
        lambda d: d.assign(vo=d.vo.isel(time=0, drop=True)),
        "have different dimensions",
    ),
    "one node": (lambda d: d.isel(lon=[0], lat=[0]), "no axis in space"),
    "dates as texts": (
        lambda d: d.assign_coords(time=("time", np.array([b"2020", b"2021", b"2022"]), {"axis": "T"})),
        "dimension time of uo .* is not an axis that is known",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_field_is_refused_in_one_line(tmp_path: Path, what: str) -> None:
    change, says = WRONG[what]
    file = save(change(dataset()), tmp_path / "a.nc")
    with pytest.raises(UsageError, match=says) as told:
        cf_samples((file,), Selection(), Placing())
    message = str(told.value)
    assert message.startswith(f"{file}: ") and message.isprintable() and message.endswith((".", "?")), message


NAMED: dict[str, tuple[dict[str, Any], str]] = {
    "a variable that is not there": (
        {"variables": (("x", "uu"), ("y", "vo"))},
        r"variable uu is not there\. There are: lat, lon",
    ),
    "an index beyond the end": ({"at": (("time", 3),)}, "at names index 3 of time, which has 3"),
    "a group that is not there": ({"group": "b"}, r"it has no group b\. Leave out group"),
    "a dimension that is not there": (
        {"at": (("tine", 0),)},
        "at names tine, which is not a dimension of its velocities. Did you mean 'time'\\?$",
    ),
}


@pytest.mark.parametrize("what", NAMED)
def test_names_that_a_file_lacks_are_reported(tmp_path: Path, what: str) -> None:
    selection, says = NAMED[what]
    with pytest.raises(UsageError, match=says):
        read(dataset(), tmp_path, **selection)


@pytest.mark.parametrize(
    "content", [b"", b"CDF\x05....", b"\x89HDF\r\n\x1a\n" + bytes(40), b"CDF\x01" + bytes(9), b"PK"]
)
def test_damaged_files_are_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.nc"
    file.write_bytes(content)
    with pytest.raises(FlowsculptError, match=r"a\.nc: it ") as told:
        cf_samples((file,), Selection(), Placing())
    assert str(told.value).isprintable()


def test_a_missing_package_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = save(dataset(), tmp_path / "a.nc")
    from flowsculpt.pipeline.plugins.fields import stored_arrays

    monkeypatch.setattr(stored_arrays, "find_spec", lambda name: None)
    with pytest.raises(
        FlowsculptError, match=r"xarray and h5netcdf and h5py; install the extra: .*flowsculpt\[fields\]"
    ):
        cf_samples((file,), Selection(), Placing())


def test_names_and_units_of_velocities_are_known() -> None:
    assert velocity_direction("eastward_wind") == ("wind", "x")
    assert velocity_direction("upward_air_velocity") == ("wind", "z")
    assert velocity_direction("sea_water_y_velocity") == ("sea_water_velocity", "y")
    assert velocity_direction("surface_downward_eastward_stress") is None
    assert velocity_direction("wind_speed") is None
    for units, factor in (
        ("m s-1", 1.0),
        ("cm/s", 0.01),
        ("km h-1", 1 / 3.6),
        ("m.s-1", 1.0),
        ("knots", 1852 / 3600),
    ):
        assert speed_factor(units) == (pytest.approx(factor), False)
    assert speed_factor("degrees/day") == (pytest.approx(np.radians(1) / 86400), True)
    assert duration("1 day") == 86400.0 and duration("6h") == 21600.0
