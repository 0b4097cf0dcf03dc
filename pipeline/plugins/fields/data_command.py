"""The command `data`: what a file of measured or simulated fields holds."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Group, RenderableType
from rich.text import Text

from flowsculpt import UsageError
from flowsculpt.api.commands import duration_words, empty_table, print_result
from flowsculpt.api.meshes import Floats
from flowsculpt.api.options import Common
from flowsculpt.api.shots import ParseContext
from flowsculpt.pipeline.plugins.fields import stored_arrays
from flowsculpt.pipeline.plugins.fields.cf_conventions import text
from flowsculpt.pipeline.plugins.fields.cf_files import cf_samples, decoded, missing_among
from flowsculpt.pipeline.plugins.fields.cf_headers import (
    FileHeader,
    Selection,
    convention_faults,
    read_header,
)
from flowsculpt.pipeline.plugins.fields.cf_numbers import name_and_unit
from flowsculpt.pipeline.plugins.fields.file_sequences import files_named
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples
from flowsculpt.pipeline.plugins.fields.grid_layout import Placing
from flowsculpt.pipeline.plugins.fields.vtk_grids import arrays_of


def data(
    common: Common,
    file: Annotated[
        Path,
        typer.Argument(
            help="NetCDF, HDF5, a Zarr store, a VTK grid or .npz; a sequence of files with a *, in quotes."
        ),
    ],
    group: Annotated[
        str | None, typer.Option(metavar="NAME", help="The group of a NetCDF 4 file or a Zarr store.")
    ] = None,
) -> None:
    """List the variables, axes and times of a file of fields, and the velocity that `sampled` would read.

    `flowsculpt data ocean.nc` also says dates, extents, what is missing, and the ranges of what colours may
    show.
    """
    files = files_named(str(file), ParseContext()) if "*" in file.name else (file,)
    facts = _stored(file, files, group) if stored_arrays.is_stored(files[0]) else _grid(file, files)
    facts["new"] = "" if group else f"flowsculpt new NAME --data {shlex.quote(str(file))}"
    print_result(_table(facts), facts, common.json)


def _stored(file: Path, files: tuple[Path, ...], group: str | None) -> dict[str, Any]:
    with stored_arrays.opened(files[0], group) as dataset:
        variables = [
            {
                "name": str(name),
                "type": str(variable.dtype),
                "dimensions": dict(zip(map(str, variable.dims), variable.shape, strict=True)),
                "units": text(variable.attrs, "units"),
                "meaning": text(variable.attrs, "standard_name") or text(variable.attrs, "long_name"),
            }
            for name, variable in dataset.variables.items()
        ]
    facts: dict[str, Any] = {"file": str(file), "variables": variables, "velocity": None}
    facts["groups"] = [] if group else stored_arrays.groups_of(files[0])
    try:
        header = read_header(files, Selection(group=group))
    except UsageError as error:
        return facts | {"problem": str(error).removeprefix(f"{files[0]}: ")}
    facts |= {"velocity": header.names, "extents": _extents(header), "times": _times(header)}
    samples, _ = cf_samples(files, Selection(group=group), Placing())
    speed = _typical_speed(samples.velocities(0))
    facts |= {"missing": _missing(header, group), "speed": speed, "notes": list(header.notes)}
    return facts | {"ranges": _ranges(header, group, _for_colours(facts))}


def _typical_speed(velocity: np.ndarray) -> float:
    """Return the median of the speeds that are not 0, m/s; 0 where all are."""
    speed = np.linalg.norm(velocity, axis=-1)
    return float(np.median(speed[speed > 0])) if speed.any() else 0.0


def _extents(header: FileHeader) -> dict[str, Any]:
    here = header.coordinates
    horizontal = "degrees" if here.is_geographic else "m"
    axes = {"x": (here.east, horizontal), "y": (here.north, horizontal), "z": (here.up, "m")}
    return {
        name: _extent(header.axes[name].coordinate, values, unit)
        for name, (values, unit) in axes.items()
        if values is not None
    }


def _extent(axis: str, values: Floats, unit: str) -> dict[str, Any]:
    ends = {"from": float(values[0]), "to": float(values[-1])}
    return {"axis": axis, **ends, "unit": unit, "nodes": len(values)}


def _times(header: FileHeader) -> dict[str, Any] | None:
    units, times = header.time_units, header.times
    if units is None:
        return None
    return {
        "count": len(times),
        "first": units.date(float(times[0])),
        "last": units.date(float(times[-1])),
        "calendar": units.calendar,
        "seconds": units.seconds * float(times[-1] - times[0]),
        "interval": units.seconds * float(np.median(np.diff(times))) if len(times) > 1 else 0.0,
    }


def _missing(header: FileHeader, group: str | None) -> dict[str, float]:
    """Return the share of missing values of the components at the first time."""
    shares = {}
    for name, raw, attributes in _at_first(header, group, header.names.values()):
        missing = missing_among(raw, attributes)
        shares[name] = 0.0 if missing is None else float(missing.mean())
    return shares


def _ranges(header: FileHeader, group: str | None, names: list[str]) -> dict[str, dict[str, Any]]:
    """Return the least and the greatest value of variables at the first time, and their units."""
    ranges = {}
    for name, raw, attributes in _at_first(header, group, names):
        values, missing = decoded(raw, attributes, is_number=True)
        known = values if missing is None else values[~missing]
        if known.size:
            ends = {"from": float(known.min()), "to": float(known.max())}
            ranges[name] = {**ends, "unit": name_and_unit(name, attributes)[1]}
    return ranges


def _at_first(
    header: FileHeader, group: str | None, names: Iterable[str]
) -> Iterator[tuple[str, np.ndarray, Mapping[str, Any]]]:
    """Yield variables at the first time as the file has them, with their attributes."""
    axis = header.axes.get("t")
    with stored_arrays.opened(header.path, group) as dataset, convention_faults(header.path):
        for name in names:
            variable = dataset.variables[name]
            first = {axis.dimension: 0} if axis and axis.dimension in variable.dims else {}
            yield name, np.asarray(variable.isel(first).values), variable.attrs


def _grid(file: Path, files: tuple[Path, ...]) -> dict[str, Any]:
    samples, _, notes = read_samples(files)
    times, variables = samples.times, [] if files[0].suffix.lower() == ".npz" else arrays_of(files[0])
    vectors = [each["name"] for each in variables if each["dimensions"]["component"] == 3]
    return {
        "file": str(file),
        "variables": variables,
        "groups": [],
        "velocity": {"xyz": vectors[0] if len(vectors) == 1 else "velocity"},
        "extents": {name: _extent(name, axis, "") for name, axis in zip("xyz", samples.axes, strict=True)},
        "times": {"count": len(times), "first": "", "last": "", "calendar": "", "interval": 0.0}
        | {"seconds": float(times[-1] - times[0])},
        "missing": {},
        "notes": list(notes),
        "ranges": {},
    }


def _table(facts: dict[str, Any]) -> RenderableType:
    table = empty_table("variable", "dimensions", "units", "meaning")
    for variable in facts["variables"]:
        shape = " × ".join(f"{name} {length}" for name, length in variable["dimensions"].items())
        table.add_row(variable["name"], shape, variable["units"], variable["meaning"])
    lines = [f"groups: {', '.join(facts['groups'])}"] if facts["groups"] else []
    if facts["velocity"] is None:
        lines.append(facts["problem"])
    else:
        lines += _velocity_lines(facts)
    parts: list[RenderableType] = [table, Text()] if facts["variables"] else []
    return Group(*parts, *map(Text, lines))


def _velocity_lines(facts: dict[str, Any]) -> list[str]:
    named = ", ".join(f"{axis}: {name}" for axis, name in facts["velocity"].items())
    lines = [f"velocity: {{{named}}}"]
    for name, extent in facts["extents"].items():
        ends, unit = (extent["from"], extent["to"]), extent["unit"]
        if name == "z" and unit == "m" and ends[1] <= 0.0:
            ends, unit = (0.0 - ends[1], -ends[0]), "m down"
        span = f"{ends[0]:.6g} to {ends[1]:.6g} {unit}".rstrip()
        lines.append(f"{name}: {extent['axis']}, {span}, {extent['nodes']} nodes")
    if times := facts["times"]:
        dates = f", {times['first']} to {times['last']} ({times['calendar']})" if times["first"] else ""
        if times["first"].startswith("-"):
            first, last = (times[end][2:7] for end in ("first", "last"))
            dates = f", {first} to {last} of any year: they are means over years"
        each = f", {duration_words(times['interval'])} apart" if times["interval"] else ""
        lines.append(f"times: {times['count']}{each}{dates}")
    lines += [f"speed: {facts['speed']:.3g} m/s at the first time (median)"] if "speed" in facts else []
    lines += [f"missing: {share:.1%} of {name}" for name, share in facts["missing"].items() if share]
    lines += facts["notes"]
    for name in _for_colours(facts):
        line = f"for colours: values: {{variable: {name}}}"
        if seen := facts["ranges"].get(name):
            line += f", {seen['from']:.4g} to {seen['to']:.4g} {seen['unit']}".rstrip() + " at the first time"
        lines.append(line)
    return [*lines, f"a shot of it: {facts['new']}"] if facts["new"] else lines


def _for_colours(facts: dict[str, Any]) -> list[str]:
    """Return the variables that colours may show: numbers on the axes of the velocities."""
    sizes, moving = (
        {each["name"]: each["dimensions"] for each in facts["variables"]},
        facts["velocity"].values(),
    )
    axes = [sizes[name].keys() for name in moving if name in sizes]
    others = [name for name in sizes if name not in moving and sizes[name].keys() in axes]
    return [name for name in others if sizes[name].get("component", 1) == 1]
