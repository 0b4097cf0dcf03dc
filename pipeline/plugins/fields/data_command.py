"""The command `data`: what a file of measured or simulated fields holds."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Group, RenderableType
from rich.text import Text

from flowsculpt import FrameError, UsageError
from flowsculpt.api.commands import duration_words, empty_table, print_result
from flowsculpt.api.meshes import Floats
from flowsculpt.api.options import Common
from flowsculpt.api.shots import ParseContext
from flowsculpt.pipeline.plugins.fields import stored_arrays
from flowsculpt.pipeline.plugins.fields.cf_conventions import text
from flowsculpt.pipeline.plugins.fields.cf_files import cf_samples, decoded
from flowsculpt.pipeline.plugins.fields.cf_headers import (
    FileHeader,
    Selection,
    convention_faults,
    read_header,
)
from flowsculpt.pipeline.plugins.fields.cf_numbers import name_and_unit
from flowsculpt.pipeline.plugins.fields.file_sequences import SEQUENCE, files_named, is_there
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
    is_one = is_there(file) or not SEQUENCE.search(file.name)
    files = (file,) if is_one else files_named(str(file), ParseContext())
    facts = _stored(file, files, group) if stored_arrays.is_stored(files[0]) else _grid(file, files)
    facts["new"] = (
        "" if group or not facts["velocity"] else f"flowsculpt new NAME --data {shlex.quote(str(file))}"
    )
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
    try:
        speed, most = _speeds(samples.velocities(0))
    except FrameError as error:
        return facts | {"velocity": None, "problem": str(error).removeprefix(f"{files[0]}: ")}
    moving = _at_first(header, group, header.names.values())
    facts |= {"missing": {name: each["missing"] for name, each in moving.items()}}
    facts |= {"speed": speed, "fastest": most}
    return facts | {"notes": list(header.notes), "ranges": _at_first(header, group, _for_colours(facts))}


def _speeds(velocity: np.ndarray) -> tuple[float, float]:
    """Return the median of the speeds that are not 0, and the largest, m/s; 0 where all are."""
    speed = np.linalg.norm(velocity, axis=-1)
    return (float(np.median(speed[speed > 0])), float(speed.max())) if speed.any() else (0.0, 0.0)


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
        "since": units.since,
        "first": units.date(float(times[0])),
        "last": units.date(float(times[-1])),
        "calendar": units.calendar,
        "seconds": units.seconds * float(times[-1] - times[0]),
        "interval": units.seconds * float(np.median(np.diff(times))) if len(times) > 1 else 0.0,
    }


def _at_first(header: FileHeader, group: str | None, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return of numbers at the first time the share that is missing, and the ends and unit of the others."""
    axis, found = header.axes.get("t"), {}
    with stored_arrays.opened(header.path, group) as dataset, convention_faults(header.path):
        for name in names:
            if (variable := dataset.variables[name]).dtype.kind not in "fiu":
                continue
            raw = np.asarray(variable.isel({axis.dimension: 0} if axis else {}).values)
            values, missing = decoded(raw, variable.attrs, is_number=True)
            known = values if missing is None else values[~missing]
            ends = {"from": float(known.min()), "to": float(known.max())} if known.size else {}
            unit = name_and_unit(name, variable.attrs)[1]
            found[name] = {"missing": 1.0 - known.size / max(1, raw.size), **ends, "unit": unit}
    return found


def _grid(file: Path, files: tuple[Path, ...]) -> dict[str, Any]:
    samples, _, notes = read_samples(files)
    times, variables = samples.times, [] if files[0].suffix.lower() == ".npz" else arrays_of(files[0])
    vectors = [each["name"] for each in variables if each["dimensions"]["component"] == 3]
    facts: dict[str, Any] = {
        "file": str(file),
        "variables": variables,
        "groups": [],
        "velocity": {"xyz": vectors[0] if len(vectors) == 1 else "velocity"},
        "extents": {name: _extent(name, axis, "") for name, axis in zip("xyz", samples.axes, strict=True)},
        "times": {"count": len(times), "since": "", "first": "", "last": "", "calendar": "", "interval": 0.0}
        | {"seconds": float(times[-1] - times[0])},
        "missing": {},
        "notes": list(notes),
    }
    return facts | {"ranges": {name: {} for name in _for_colours(facts)}}


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
        if times["since"] and not dates:
            dates = f", without dates: '{times['since']}' cannot be read ({times['calendar']})"
        if times["first"].startswith("-"):
            first, last = (times[end][2:7] for end in ("first", "last"))
            dates = f", {first} to {last} of any year: they are means over years"
        each = f", {duration_words(times['interval'])} apart" if times["interval"] else ""
        lines.append(f"times: {times['count']}{each}{dates}")
    if "speed" in facts:
        median, most = facts["speed"], facts["fastest"]
        lines.append(f"speed: {median:.3g} m/s at the first time (median), {most:.3g} at most")
    lines += [f"missing: {share:.1%} of {name}" for name, share in facts["missing"].items() if share]
    lines += facts["notes"]
    for name, seen in facts["ranges"].items():
        line = f"for colours: values: {{variable: {name}}}"
        if "from" in seen:
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
