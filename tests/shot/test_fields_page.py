"""docs/fields.md says what is so: its examples can be read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.shot import read_shot
from tests.needed_plugins import shot_rows

PAGE = Path(__file__).parents[2] / "docs" / "fields.md"
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
HEAD = "title: T\nframes: 1-24\nsubject: {solid: icosphere}\nresample: off\nflows:\n"
IMAGE = (
    '<VTKFile type="ImageData"><ImageData><Piece Extent="0 1 0 1 0 1"><PointData><DataArray type="Float32" '
    f'Name="u" NumberOfComponents="3" format="ascii">{"1 2 3 " * 8}</DataArray></PointData></Piece>'
    "</ImageData></VTKFile>"
)

SEA = ("eastward", "northward")
TETRAHEDRON = """<VTKFile type="UnstructuredGrid">
<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1">
<PointData><DataArray type="Float32" Name="U" NumberOfComponents="3" format="ascii">
1 2 3 1 2 3 1 2 3 1 2 3</DataArray></PointData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">
0 0 0 4 0 0 0 1 0 0 0 1</DataArray></Points>
<Cells><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">4</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">10</DataArray></Cells>
</Piece></UnstructuredGrid></VTKFile>"""


def write_ocean(folder: Path) -> None:
    """Write a sea of two days, as NetCDF of both days and of each, and as Zarr."""
    xarray = pytest.importorskip("xarray")
    dims, units = ("time", "depth", "lat", "lon"), {"units": "m s-1"}
    data = xarray.Dataset(
        {name: (dims, np.ones((2, 2, 3, 4)), units) for name in ("uo", "vo", "wo")},
        {
            "time": ("time", [0, 1], {"units": "days since 2020-01-01"}),
            "depth": ("depth", [0.0, 10.0], {"units": "m", "positive": "down"}),
            "lat": ("lat", [50.0, 51.0, 52.0], {"units": "degrees_north"}),
            "lon": ("lon", [0.0, 1.0, 2.0, 3.0], {"units": "degrees_east"}),
        },
    )
    for name, part in (("ocean", data), ("ocean_1", data.isel(time=[0])), ("ocean_2", data.isel(time=[1]))):
        part.to_netcdf(folder / f"{name}.nc", engine="h5netcdf")
    data.to_zarr(folder / "ocean.zarr", zarr_format=2)
    for name in ("uo", "vo"):
        data[[name]].to_netcdf(folder / f"{name[0]}wnd_mean.nc", engine="h5netcdf")


def write_bent(folder: Path) -> None:
    """Write a sea whose longitudes and latitudes have two dimensions, and velocities in a tetrahedron."""
    xarray = pytest.importorskip("xarray")
    north, east = np.meshgrid([50.0, 51.0, 52.0], [0.0, 1.0, 2.0, 3.0], indexing="ij")
    speed = {name: {"units": "m s-1", "standard_name": f"{name}_sea_water_velocity"} for name in SEA}
    xarray.Dataset(
        {name: (("y", "x"), np.ones((3, 4)), speed[name]) for name in SEA},
        {"nav_lon": (("y", "x"), east), "nav_lat": (("y", "x"), north)},
    ).to_netcdf(folder / "nemo.nc", engine="h5netcdf")
    (folder / "engine.vtu").write_text(TETRAHEDRON)


@pytest.mark.parametrize("example", shot_rows(EXAMPLES))
def test_every_example_of_the_page_is_read(example: str, tmp_path: Path) -> None:
    axis = np.linspace(0, 1, 3)
    for name in ("smoke_1", "smoke_2"):
        np.savez(tmp_path / f"{name}.npz", x=axis, y=axis, z=axis, velocity=np.ones((3, 3, 3, 3)))
    (tmp_path / "wind.vti").write_text(IMAGE)
    if "ocean" in example or "uwnd" in example:
        write_ocean(tmp_path)
    if "nemo" in example:
        write_bent(tmp_path)
    (tmp_path / "stone.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "flows").mkdir()
    (tmp_path / "flows" / "mine.py").write_text("def swirl(points, time, dt):\n    return points\n")
    shot = read_shot(tmp_path / "a.yaml", HEAD + "".join(f"  {line}\n" for line in example.splitlines()))
    assert len(shot.motion.flow.flows) == len(re.findall(r"^- ", example, flags=re.M))  # type: ignore[attr-defined]
