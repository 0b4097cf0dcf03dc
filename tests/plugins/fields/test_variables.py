"""Variables of data files as what surfaces and lines from seeds show: at the right place, time and unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt import MissingInputError
from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.plugins.fields.cf_conventions import ConventionError, TimeUnits
from flowsculpt.pipeline.plugins.fields.grid_layout import EARTH
from flowsculpt.pipeline.shot import read_shot
from tests.needed_plugins import needs_plugins

xarray = pytest.importorskip("xarray")
pytestmark = needs_plugins("streams")

LON, LAT, DEPTH = np.linspace(10.0, 20.0, 21), np.linspace(-5.0, 5.0, 21), np.array([0.5, 100.0, 400.0])


def write_ocean(path: Path, first: float = 0.0, what: str = "all", lat: np.ndarray = LAT) -> Path:
    """Write a current to the east of 1 m/s, and lat + 0.1 (lon − 15) + 2 a day degrees, none in the east."""
    days = first + np.arange(4.0)
    t, _, n, e = np.meshgrid(days, DEPTH, lat, LON, indexing="ij")
    dims = ("time", "depth", "lat", "lon")
    heat = np.where(e <= 18.0, n + 0.1 * (e - 15.0) + 2.0 * (t - first) + 2.0 * first, np.nan)
    speed = {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}
    current = {
        "uo": (dims, np.ones_like(e), speed),
        "vo": (dims, np.zeros_like(e), {**speed, "standard_name": "northward_sea_water_velocity"}),
    }
    warmth = {"thetao": (dims, heat, {"long_name": "Temperature", "units": "degC"})}
    warmth["sst"] = (("time", "lat", "lon"), heat[:, 0], {"units": "K"})
    data = xarray.Dataset(
        {"all": {**current, **warmth}, "current": current, "warmth": warmth}[what],
        {
            "time": ("time", days, {"units": "days since 2003-08-01", "calendar": "standard"}),
            "depth": ("depth", DEPTH, {"units": "m", "positive": "down", "standard_name": "depth"}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"}),
        },
    )
    data.to_netcdf(path, engine="h5netcdf", encoding={k: {"dtype": "f4"} for k in data.data_vars})
    return path


def shot_of(folder: Path, values: str, line: str, more: str = "fit: 4", kind: str = "streak_lines") -> Any:
    velocity = f"[{{sampled: {{file: ocean.nc, time_scale: 1 day, {more}}}}}]"
    subject = f"{{{kind}: {{line: {line}}}, velocity: {velocity}, count: 9, radius: 0.001, values: {values}}}"
    look = "{material: clay, measure: {values: {}}}"
    text = f"title: T\nframes: 1-25\nrate: 24\nsubject: {subject}\nlook: {look}\n"
    return read_shot(folder / "a.yaml", text)


def heat_at(points: np.ndarray, days: float, last: float = 18.45) -> np.ndarray:
    """Return temperatures at points of a plane 4 wide over 10 degrees, north at −z; NaN without.

    last  longitude up to which the cell at 18 degrees has those of its nodes
    """
    lon, lat = 15.0 + points[:, 0] * 2.5, -points[:, 2] * 2.5
    known = lat + 0.1 * (np.minimum(lon, 18.0) - 15.0) + 2.0 * days
    return np.where(lon <= last, known, np.where(lon >= 18.55, np.nan, 1e9))


def require_heat(shot: Any, days: float, last: float = 18.45, frame: int = 25) -> None:
    (mesh,) = (each.mesh for each in animate(shot, only=frozenset({frame})))
    summed, known = mesh.attributes["values"].T
    expected = heat_at(mesh.vertices, days, last)
    sure = expected != 1e9
    assert np.isnan(expected[sure]).any() and np.isfinite(expected[sure]).any()
    assert np.array_equal(known[sure] == 1.0, np.isfinite(expected[sure]))
    shown = known == 1.0
    assert summed[shown & sure] == pytest.approx(expected[shown & sure], abs=0.02)


ACROSS = "[[-1.5, -0.00005, 0.7], [1.9, -0.00005, 0.2]]"


@pytest.mark.parametrize("variable", ["thetao", "sst"])
@pytest.mark.parametrize("more", ["fit: 4", "fit: 4, between: cubic", "fit: 4, start: 86400"])
def test_values_are_those_of_the_variable_where_a_point_is_at_the_time_of_the_frame(
    tmp_path: Path, variable: str, more: str
) -> None:
    write_ocean(tmp_path / "ocean.nc")
    require_heat(
        shot_of(tmp_path, f"{{variable: {variable}}}", ACROSS, more),
        2.0 if "start" in more else 1.0,
        18.0 if "cubic" in more else 18.45,
    )


def test_another_file_is_read_at_the_same_dates(tmp_path: Path) -> None:
    write_ocean(tmp_path / "ocean.nc", what="current")
    write_ocean(tmp_path / "heat.nc", first=-1.0, what="warmth")
    require_heat(shot_of(tmp_path, "{variable: thetao, file: heat.nc}", ACROSS), 1.0)


def test_files_that_descend_and_spheres_have_the_same_values(tmp_path: Path) -> None:
    write_ocean(tmp_path / "ocean.nc", lat=LAT[::-1])
    require_heat(shot_of(tmp_path, "{variable: thetao}", ACROSS), 1.0)
    lon, lat = np.radians([12.0, 16.0]), np.radians([-2.0, 3.0])
    ends = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], axis=1)
    line = str((ends * (1.0 - 50.0 / EARTH)).tolist())
    shot = shot_of(tmp_path, "{variable: thetao}", line, "map: sphere")
    (mesh,) = (each.mesh for each in animate(shot, only=frozenset({25})))
    x, y, z = mesh.vertices.T
    lon, lat = np.degrees(np.arctan2(x, z)), np.degrees(np.arcsin(y / np.linalg.norm(mesh.vertices, axis=1)))
    summed, known = mesh.attributes["values"].T
    assert (known == 1.0).all() and summed == pytest.approx(
        lat + 0.1 * (lon - 15.0) + 2.0,
        abs=0.08,  # degrees in the radius of a tube
    )


def test_paths_keep_what_was_there_when_they_passed(tmp_path: Path) -> None:
    write_ocean(tmp_path / "ocean.nc")
    line = "[[-1.5, -0.0001, 0.7], [-1.5, -0.0001, 0.2]]"
    shot = shot_of(tmp_path, "{variable: thetao}", line, kind="path_lines")
    (mesh,) = (each.mesh for each in animate(shot, only=frozenset({25})))
    ages = (mesh.vertices[:, 0] + 1.5) * np.radians(2.5) * EARTH / 86400.0  # days, at 1 m/s
    summed, known = mesh.attributes["values"].T
    begun = -1.0 / 24.0  # a frame before the first
    assert (known == 1.0).all()
    assert summed == pytest.approx(heat_at(mesh.vertices, np.maximum(ages + begun, 0.0)), abs=0.03)


def test_measures_of_data_have_units_of_data_and_dates(tmp_path: Path) -> None:
    write_ocean(tmp_path / "ocean.nc")
    sequence = shot_of(tmp_path, "speed", ACROSS).motion.animated.model.sequence
    facts = sequence.facts(1.0)
    assert (facts["values"], facts["unit"], facts["date"]) == ("speed", "m/s", "2003-08-02 00:00:00")
    assert facts["metres"] == pytest.approx(np.radians(10.0) * EARTH / 4.0)
    mesh, _ = sequence.surface(1.0)
    assert mesh.attributes["values"][:, 0] == pytest.approx(1.0, rel=0.01)
    age = shot_of(tmp_path, "age", ACROSS).motion.animated.model.sequence
    assert age.facts(0.0)["unit"] == "days"
    assert age.surface(1.0)[0].attributes["values"][:, 0].max() == pytest.approx(25.0 / 24.0)
    heat = shot_of(tmp_path, "{variable: thetao}", ACROSS).motion.animated.model.sequence
    assert (heat.facts(0.0)["values"], heat.facts(0.0)["unit"]) == ("Temperature", "°C")


def test_means_over_years_have_dates_without_a_year() -> None:
    attributes = {"units": "days since 2001-01-01", "calendar": "noleap"}
    assert TimeUnits.of(attributes, [45.5]).date(45.5) == "2001-02-15 12:00:00"
    assert TimeUnits.of({**attributes, "climatology": "bounds"}, [45.5]).date(45.5) == "--02-15 12:00:00"
    of_year_zero = {"units": "hours since 0000-01-01 00:00:00"}
    assert TimeUnits.of(of_year_zero, [24 * 45.5]).date(24 * 45.5) == "--02-15 12:00:00"


@pytest.mark.parametrize(
    ("calendar", "day", "date"),
    [
        ("noleap", 365.0 * 12.0 + 45.5, "0012-02-15 12:00:00"),  # as climate models count
        ("standard", 730_000.0, "1998-09-01 00:00:00"),
        ("proleptic_gregorian", 730_000.0, "1998-09-03 00:00:00"),  # as datetime.date.fromordinal(729_635)
    ],
)
@pytest.mark.filterwarnings("error")
def test_times_that_go_on_after_year_0_have_dates_with_a_year(calendar: str, day: float, date: str) -> None:
    units = TimeUnits.of({"units": "days since 0000-01-01", "calendar": calendar}, [day, day + 30.0])
    assert units.date(day) == date and not units.is_climatology
    assert units.number_of(date) == day
    other = TimeUnits.of({"units": "days since 2001-01-01", "calendar": calendar}, [0.0])
    assert units.seconds_between(other) == 86400.0 * units.number_of("2001-01-01")


def test_a_date_that_cannot_be_read_is_refused_where_files_follow_one_another() -> None:
    one, other = (TimeUnits.of({"units": f"days since {day}"}, [0.0]) for day in ("2001-01-01", "then"))
    with pytest.raises(ConventionError, match="'2001-01-01' or 'then' is not a date of its calendar"):
        one.seconds_between(other)


@pytest.mark.parametrize("suffix", ["npz", "vti"])
def test_grids_of_other_formats_have_numbers_too(tmp_path: Path, suffix: str) -> None:
    axis = np.linspace(-2.0, 2.0, 9)
    x, y, _ = np.meshgrid(axis, axis, axis, indexing="ij")
    velocity, heat = np.stack([np.ones_like(x), 0.0 * x, 0.0 * x], axis=-1), 3.0 * x + y
    if suffix == "npz":
        np.savez(tmp_path / "a.npz", x=axis, y=axis, z=axis, velocity=velocity, heat=heat)
    else:
        arrays = [
            f'<DataArray type="Float64" Name="{name}" NumberOfComponents="{count}" format="ascii">'
            f"{' '.join(map(repr, np.swapaxes(values, 0, 2).ravel().tolist()))}</DataArray>"
            for name, count, values in (("v", 3, velocity), ("heat", 1, heat))
        ]
        grid = 'WholeExtent="0 8 0 8 0 8" Origin="-2 -2 -2" Spacing="0.5 0.5 0.5"'
        piece = f'<Piece Extent="0 8 0 8 0 8"><PointData>{"".join(arrays)}</PointData></Piece>'
        text = f'<VTKFile type="ImageData" version="1.0"><ImageData {grid}>{piece}</ImageData></VTKFile>'
        (tmp_path / "a.vti").write_text(text)
    subject = (
        f"{{path_lines: {{line: [[-1, -1, 0], [-1, 1, 0]]}}, velocity: [{{sampled: {{file: a.{suffix}}}}}], "
        "radius: 0.001, values: {variable: heat}}"
    )
    shot = read_shot(tmp_path / "a.yaml", f"title: T\nframes: 1-5\nsubject: {subject}\n")
    *_, last = animate(shot)
    expected = 3.0 * last.mesh.vertices[:, 0] + last.mesh.vertices[:, 1]
    assert last.mesh.attributes["values"][:, 0] == pytest.approx(expected, abs=0.01)


def test_what_changes_in_a_variable_makes_its_frames_stale(tmp_path: Path) -> None:
    write_ocean(tmp_path / "ocean.nc", what="current")

    def keys(first: float) -> list[Any]:
        write_ocean(tmp_path / "heat.nc", first=first, what="warmth")
        motion = shot_of(tmp_path, "{variable: thetao, file: heat.nc}", ACROSS).motion
        return [motion.animated.data(number) for number in motion.frames]

    before = keys(-1.0)
    assert keys(-1.0) == before
    assert all(one != other for one, other in zip(before, keys(-2.0), strict=True))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("{variable: thetaa}", "variable thetaa is not there. Did you mean 'thetao'?"),
        ("{variable: time}", "no axis in space"),
        ("{variable: thetao, file: coarse.nc}", "differ from those of the velocities"),
        ("{variable: thetao, file: none.nc}", "none.nc"),
    ],
)
def test_mistakes_are_named_with_their_place_and_remedy(tmp_path: Path, values: str, message: str) -> None:
    write_ocean(tmp_path / "ocean.nc")
    write_ocean(tmp_path / "coarse.nc", lat=np.linspace(-4.0, 4.0, 5))
    with pytest.raises((ShotError, MissingInputError), match=r"a\.yaml:4:") as caught:
        shot_of(tmp_path, values, ACROSS)
    assert message in str(caught.value)


def test_a_variable_needs_velocities_of_data(tmp_path: Path) -> None:
    subject = "{path_lines: {line: [[0, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], values: {variable: heat}}"
    with pytest.raises(ShotError, match=r"a\.yaml:3:.*that has 0 entries with data"):
        read_shot(tmp_path / "a.yaml", f"title: T\nframes: 1-5\nsubject: {subject}\n")
