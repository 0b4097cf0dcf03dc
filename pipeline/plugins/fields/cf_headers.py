"""Headers of files that follow the CF conventions: which variables, on which axes, at which times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api import suggest
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields import stored_arrays
from flowsculpt.pipeline.plugins.fields.cf_conventions import (
    EAST,
    LENGTHS,
    NORTH,
    PRESSURES,
    TIME,
    UP,
    ConventionError,
    TimeUnits,
    attribute_number,
    axis_of,
    is_degrees,
    speed_factor,
    standard_height,
    text,
    velocities_among,
)
from flowsculpt.pipeline.plugins.fields.curvilinear_grids import (
    Along,
    CurvilinearGrid,
    direction_of,
    shared_grid,
    two_dimensional,
)
from flowsculpt.pipeline.plugins.fields.grid_layout import Coordinates

FILLED = 9e36
"""Numbers from here on are what NetCDF writes where nothing was written (9.97e36)."""


@dataclass(frozen=True)
class Selection:
    """The variables, indices and group that a shot names in a file.

    variables  names of the components by `x`, `y`, `z`; empty: found by their standard names
    at         indices of dimensions that are not axes, or of axes to leave out
    group      of NetCDF 4 and Zarr; None is the first
    interval   seconds from file to file, where files have no times
    along      of a curvilinear grid: what the components go along; None: as their standard names say
    resolution  of a curvilinear grid: nodes along the longer side of the even one in its place
    is_number  True if `x` names a variable that is a number, not a velocity
    """

    variables: tuple[tuple[str, str], ...] = ()
    at: tuple[tuple[str, int], ...] = ()
    group: str | None = None
    interval: float = 1.0
    along: Along | None = None
    resolution: int | None = None
    is_number: bool = False


@dataclass(frozen=True)
class Axis:
    """A dimension of a variable, and what it measures.

    dimension   its name
    coordinate  the name of its coordinate variable
    values      (n,) as the file has them
    attributes  of the coordinate
    """

    dimension: str
    coordinate: str
    values: Floats
    attributes: Mapping[str, Any] = field(hash=False)


@dataclass(frozen=True)
class FileHeader:
    """Everything of a file, or of several with a component each, but the velocities.

    names        variables by component
    axes         by `x`, `y`, `z` and `t`; those that the data have
    coordinates  in degrees or metres
    turned       axes that are descending in the file
    times        (T,) as the file writes them; none where it has no time
    curvilinear  the grid of the file, where its longitudes have two dimensions; `axes` has the even one
    """

    paths: tuple[Path, ...]
    names: dict[str, str]
    axes: dict[str, Axis]
    coordinates: Coordinates
    turned: frozenset[str]
    times: Floats
    time_units: TimeUnits | None
    is_angular: bool
    notes: tuple[str, ...]
    curvilinear: CurvilinearGrid | None = None

    @property
    def path(self) -> Path:
        return self.paths[0]


@contextmanager
def convention_faults(path: Path) -> Iterator[None]:
    """Turn what breaks the conventions into a UsageError with the name of the file."""
    try:
        yield
    except ConventionError as error:
        raise UsageError(f"{path}: {error}{'' if str(error).endswith('?') else '.'}") from None


def read_header(paths: tuple[Path, ...], selection: Selection) -> FileHeader:
    """Return what a file holds, or several that have a component each.

    Raises UsageError where it is no field, MachineError without xarray.
    """
    with stored_arrays.opened_together(paths, selection.group) as dataset, convention_faults(paths[0]):
        return _HeaderReader(paths, dataset, selection).header()


@dataclass(frozen=True, eq=False)
class _HeaderReader:
    paths: tuple[Path, ...]
    dataset: Any
    selection: Selection
    notes: list[str] = field(default_factory=list)
    curvilinear: dict[str, CurvilinearGrid] = field(default_factory=dict)

    def header(self) -> FileHeader:
        names = self._names()
        axes = self._common_axes(names)
        dimensions = {str(each) for name in names.values() for each in self.dataset.variables[name].dims}
        for name, _ in self.selection.at if not self.selection.is_number else ():
            if name not in dimensions:
                hint = suggest(name, sorted(dimensions)).rstrip(".")
                raise ConventionError(f"at names {name}, which is not a dimension of its velocities. {hint}")
        turned = set[str]()
        placed = {
            axis: self._coordinate(axis, axes[axis], turned) for axis in (EAST, NORTH, UP) if axis in axes
        }
        degrees = {axis: is_degrees(text(axes[axis].attributes, "units")) or self._names_degrees(axes[axis])
                   for axis in (EAST, NORTH) if axis in axes}  # fmt: skip
        if len(set(degrees.values())) > 1:
            raise ConventionError(
                f"axis {axes[EAST].coordinate} and axis {axes[NORTH].coordinate} have different "
                "units, degrees and lengths; correct their units"
            )
        is_geographic = any(degrees.values())
        self._check_degrees(placed, is_geographic)
        if not placed:
            raise ConventionError("its velocities have no axis in space; a field has two or three")
        vertical = axes.get(UP) or self._chosen_level(names[next(iter(names))])
        is_height = vertical is not None and (
            is_geographic or any(text(vertical.attributes, name) for name in ("positive", "standard_name"))
        )
        coordinates = Coordinates(
            placed.get(EAST), placed.get(NORTH), placed.get(UP), is_geographic, is_height
        )
        times, units = self._times(axes.get(TIME))
        return FileHeader(
            self.paths,
            names,
            axes,
            coordinates,
            frozenset(turned),
            times,
            units,
            not self.selection.is_number and self._units(names),
            tuple(dict.fromkeys(self.notes)),
            self._curvilinear(names),
        )

    # Variables

    def _names(self) -> dict[str, str]:
        variables = self.dataset.variables
        if self.selection.variables:
            names, is_number = dict(self.selection.variables), self.selection.is_number
            there = sorted(str(each) for each in variables if not is_number or variables[each].ndim > 1)
            for name in names.values():
                if name not in variables:
                    raise ConventionError(f"variable {name} is not there. {suggest(name, there)}".rstrip("."))
                if is_number and variables[name].dtype.kind not in "fiu":
                    raise ConventionError(f"variable {name} holds {variables[name].dtype}, not numbers")
            return names
        known = {
            str(name): text(variable.attrs, "standard_name")
            for name, variable in variables.items()
            if variable.dims and variable.dtype.kind in "fiu"
        }
        found = velocities_among(known)
        if not found:
            seen = ", ".join(sorted(known)[:8]) or "no variable with numbers"
            groups = [] if known else stored_arrays.groups_of(self.paths[0])
            if groups:
                raise ConventionError(
                    f"its first group has no variables, and others have: {', '.join(groups[:8])}; write "
                    f"group: {groups[0]}"
                )
            raise ConventionError(
                f"no variables are velocities by standard_name (such as eastward_wind) or name; "
                f"it has {seen}. Write variables: {{x: NAME, y: NAME}}"
            )
        if len(found) > 1:
            listed = " or ".join(
                "{" + ", ".join(f"{axis}: {name}" for axis, name in each.items()) + "}" for each in found
            )
            raise ConventionError(f"there are {len(found)} velocities in it. Write variables: {listed}")
        names = found[0]
        if UP in names and not self._is_speed(names[UP]):
            self.notes.append(
                f"{names[UP]} is left out: its units are {text(variables[names[UP]].attrs, 'units')}"
            )
            del names[UP]
        return names

    def _is_speed(self, name: str) -> bool:
        units = text(self.dataset.variables[name].attrs, "units")
        try:
            return not units or not speed_factor(units)[1]
        except ConventionError:
            return False

    def _units(self, names: Mapping[str, str]) -> bool:
        """Return whether horizontal velocities are angles; check the units of all."""
        angular = {}
        for axis, name in names.items():
            variable = self.dataset.variables[name]
            if variable.dtype.kind not in "fiu":
                raise ConventionError(f"variable {name} holds {variable.dtype}; a component is numbers")
            units = text(variable.attrs, "units")
            if units in ("", "1"):
                self.notes.append(f"{name} has no units; it is taken as m/s")
                units = "m s-1"
            try:
                angular[axis] = speed_factor(units)[1]
            except ConventionError as error:
                raise ConventionError(f"variable {name}: {error}") from None
            for attribute in ("scale_factor", "add_offset"):
                attribute_number(variable.attrs, attribute, name)
        horizontal = {angular[axis] for axis in (EAST, NORTH) if axis in angular}
        if len(horizontal) > 1 or angular.get(UP):
            raise ConventionError(
                "some of its components are in m/s and others in degrees/s; correct their units"
            )
        return horizontal == {True}

    # Axes

    def _common_axes(self, names: Mapping[str, str]) -> dict[str, Axis]:
        found = {name: self._axes(name) for name in names.values()}
        first_name, first = next(iter(found.items()))
        for name, axes in found.items():
            for axis in sorted({*first, *axes}):
                one, other = first.get(axis), axes.get(axis)
                if one is None or other is None:
                    raise ConventionError(
                        f"{first_name} and {name} have different dimensions; select one of a dimension by "
                        "at: {NAME: 0}"
                    )
                if len(one.values) != len(other.values) or not np.allclose(
                    one.values, other.values, rtol=1e-6, atol=0
                ):
                    raise ConventionError(
                        f"{first_name} and {name} are at different places ({one.coordinate} and "
                        f"{other.coordinate}), as on a staggered grid; interpolate them to one grid "
                        "first, for example with xgcm or cdo"
                    )
        return first

    def _axes(self, name: str) -> dict[str, Axis]:
        variable, chosen = self.dataset.variables[name], dict(self.selection.at)
        axes = self._even_axes(name, variable)
        even = {axis.dimension for axis in axes.values()}
        if not axes:
            self._require_regular(name, variable)
        for dimension, length in zip(variable.dims, variable.shape, strict=True):
            if dimension in even:
                continue
            if dimension in chosen:
                if chosen[dimension] >= length:
                    raise ConventionError(
                        f"at names index {chosen[dimension]} of {dimension}, which has {length}"
                    )
                continue
            axis = self._axis(str(dimension), length)
            role = None if axis is None else axis_of(axis.coordinate, axis.attributes)
            if role is None or axis is None:
                if length == 1:
                    continue
                raise ConventionError(
                    f"dimension {dimension} of {name} ({length} long) is not an axis that is known; say "
                    f"so by its attribute axis, or choose one of it: at: {{{dimension}: 0}}"
                )
            if role in axes:
                raise ConventionError(
                    f"{name} has two axes {role}, {axes[role].coordinate} and {axis.coordinate}; choose one "
                    f"of a dimension: at: {{{dimension}: 0}}"
                )
            if length == 1 and role != TIME:
                continue
            if length == 0:
                raise ConventionError(
                    f"{axis.coordinate} has a length of 0, so nothing has a velocity; write the file again"
                )
            axes[role] = axis
        if not axes.keys() & {EAST, NORTH, UP}:
            raise ConventionError(f"{name} has no axis in space of two or more nodes")
        return axes

    def _chosen_level(self, name: str) -> Axis | None:
        """Return the vertical axis of which `at` chooses one level; None where it chooses none."""
        for dimension in dict(self.selection.at):
            with suppress(ConventionError):  # of coordinates that nothing reads
                axis = self._axis(dimension, 0) if dimension in self.dataset.variables[name].dims else None
                if axis and len(axis.values) > 1 and axis_of(axis.coordinate, axis.attributes) == UP:
                    return axis
        return None

    def _even_axes(self, name: str, variable: Any) -> dict[str, Axis]:
        """Return the axes of the even grid in place of a curvilinear one; none for other grids."""
        found = two_dimensional(self.dataset.variables, variable)
        dimensions = () if found is None else self.dataset.variables[found[0]].dims
        if found is None or all(self._is_axis(str(dimension)) for dimension in dimensions):
            return {}
        if self.dataset.variables[found[1]].dims != dimensions:
            raise ConventionError(f"{found[0]} and {found[1]} have different dimensions; correct them")
        degrees = [
            np.asarray(self.dataset.variables[each].values, np.float64).T for each in found
        ]  # the last dimension is the first direction of the grid
        along = self.selection.along or direction_of(name, variable.attrs)
        made = CurvilinearGrid(degrees[0], degrees[1], self.selection.resolution, along)
        self.curvilinear[name] = made
        east, north = made.grid.axes
        second, first = map(str, dimensions)
        return {
            EAST: Axis(first, found[0], east, {"units": "degrees_east"}),
            NORTH: Axis(second, found[1], north, {"units": "degrees_north"}),
        }

    def _is_axis(self, dimension: str) -> bool:
        """Tell whether a dimension has a coordinate of its own that measures east or north."""
        axis = self._axis(dimension, 0)
        return axis is not None and axis_of(axis.coordinate, axis.attributes) in (EAST, NORTH)

    def _curvilinear(self, names: Mapping[str, str]) -> CurvilinearGrid | None:
        """Return the curvilinear grid that all components share; None for other grids."""
        if self.curvilinear and self.selection.is_number:
            return self.curvilinear[names[EAST]]
        if self.curvilinear:
            return shared_grid({axis: self.curvilinear.get(name) for axis, name in names.items()})
        if (self.selection.along or self.selection.resolution) and not self.selection.is_number:
            raise ConventionError(
                "along and resolution are for curvilinear grids, and its grid is not one. Remove them"
            )
        return None

    def _axis(self, dimension: str, length: int) -> Axis | None:
        coordinate = self.dataset.variables.get(dimension)
        name = dimension
        if coordinate is None or coordinate.dims != (dimension,):
            others = [
                (str(other), variable)
                for other, variable in self.dataset.variables.items()
                if variable.dims == (dimension,)
                and axis_of(str(other), variable.attrs)
                and not str(other).endswith("bnds")
            ]
            if len(others) != 1:
                return None
            name, coordinate = others[0]
        if coordinate.dtype.kind not in "fiu":
            raise ConventionError(
                f"coordinate {name} holds {coordinate.dtype}, not numbers; write numbers with units"
            )
        values = np.asarray(coordinate.values, np.float64)
        if not np.isfinite(values).all() or (np.abs(values) >= FILLED).any():
            raise ConventionError(f"coordinate {name} has missing values; give it all of them")
        scale, offset = (
            attribute_number(coordinate.attrs, each, name) for each in ("scale_factor", "add_offset")
        )
        return Axis(
            dimension,
            name,
            values * (1.0 if scale is None else scale) + (offset or 0.0),
            dict(coordinate.attrs),
        )

    def _require_regular(self, name: str, variable: Any) -> None:
        """Raise ConventionError where longitudes and latitudes are of two dimensions, or nodes are loose."""
        named = text(variable.attrs, "coordinates").split()
        for other in named or list(self.dataset.variables):
            if (coordinate := self.dataset.variables.get(other)) is None:
                continue
            standard = text(coordinate.attrs, "standard_name")
            if standard not in ("longitude", "latitude") or not set(coordinate.dims) <= set(variable.dims):
                continue
            regular = all(self._axis(str(dimension), 0) for dimension in coordinate.dims)
            if len(coordinate.dims) > 1 and not regular:
                raise ConventionError(
                    f"{name} is on a curvilinear grid ({other} has {len(coordinate.dims)} dimensions); put "
                    "it on one of longitudes and latitudes first, for example by cdo remapbil,r720x360 IN OUT"
                )
        loose = text(variable.attrs, "mesh") or text(variable.attrs, "location")
        shared = [
            dimension
            for dimension in variable.dims
            if {
                text(other.attrs, "standard_name")
                for other in self.dataset.variables.values()
                if other.dims == (dimension,)
            }
            >= {"longitude", "latitude"}
        ]
        if loose or shared:
            raise ConventionError(
                f"{name} is on an unstructured mesh; put it on a grid of longitudes and latitudes first, for "
                "example by cdo remapnn,r720x360 IN OUT"
            )

    def _names_degrees(self, axis: Axis) -> bool:
        """Tell whether an axis without units is of degrees by its name."""
        if text(axis.attributes, "units"):
            return False
        named = text(axis.attributes, "standard_name") or axis.coordinate.lower()
        if named in ("lon", "lat", "longitude", "latitude", "grid_longitude", "grid_latitude"):
            self.notes.append(f"{axis.coordinate} has no units; it is taken as degrees")
            return True
        return False

    def _check_degrees(self, placed: Mapping[str, Floats], is_geographic: bool) -> None:
        if not is_geographic:
            return
        if NORTH in placed and np.abs(placed[NORTH]).max() > 90.0 + 1e-6:
            raise ConventionError(
                f"latitude {np.abs(placed[NORTH]).max():g} is beyond a pole; correct the axis"
            )
        if EAST in placed and np.ptp(placed[EAST]) > 360.0 + 1e-6:
            raise ConventionError(f"longitudes go {np.ptp(placed[EAST]):g} degrees around; 360 are the most")

    def _coordinate(self, axis: str, given: Axis, turned: set[str]) -> Floats:
        """Return an axis ascending, in degrees or metres; note whether it is turned."""
        values, units = given.values, text(given.attributes, "units")
        if axis == UP:
            values = self._heights(given)
        elif axis == EAST and (is_degrees(units) or self._names_degrees(given)):
            values = np.concatenate(
                [values[:1], values[0] + np.cumsum((np.diff(values) + 180.0) % 360.0 - 180.0)]
            )
        elif not is_degrees(units) and not self._names_degrees(given):
            values = values * self._length(given)
        steps = np.diff(values)
        if (steps < 0).all():
            turned.add(axis)
            values, steps = values[::-1], -steps[::-1]
        if not (steps > 0).all():
            raise ConventionError(
                f"coordinate {given.coordinate} neither ascends nor descends throughout; sort it, and remove "
                "values that come twice"
            )
        return np.ascontiguousarray(values)

    def _length(self, axis: Axis) -> float:
        units = text(axis.attributes, "units")
        if units in ("", "1"):
            self.notes.append(f"{axis.coordinate} has no units; it is taken as metres")
            return 1.0
        if units.lower() not in LENGTHS:
            raise ConventionError(
                f"coordinate {axis.coordinate} has the units {units!r}; an axis in space is in degrees "
                "or metres"
            )
        return LENGTHS[units.lower()]

    def _heights(self, axis: Axis) -> Floats:
        units, standard = text(axis.attributes, "units").lower(), text(axis.attributes, "standard_name")
        if units in PRESSURES and standard != "depth":
            about = "is a pressure; heights are those of the standard atmosphere"
            self.notes.append(f"{axis.coordinate} {about}")
            return np.array(standard_height((axis.values * PRESSURES[units]).tolist()))
        is_formula = "formula_terms" in axis.attributes or "sigma" in standard or "_s_coordinate" in standard
        if is_formula or units in ("level", "layer", "sigma_level"):
            raise ConventionError(
                f"coordinate {axis.coordinate} counts levels, and their heights vary; interpolate to "
                f"heights, or choose one: at: {{{axis.dimension}: 0}}"
            )
        is_down = text(axis.attributes, "positive").lower() == "down" or standard.startswith("depth")
        if is_down and axis.values.min() < 0.0 >= axis.values.max():
            self.notes.append(f"{axis.coordinate} is of depths, and its numbers below 0 go down too")
            is_down = False
        return (-1.0 if is_down else 1.0) * self._length(axis) * axis.values + 0.0  # no -0

    def _times(self, axis: Axis | None) -> tuple[Floats, TimeUnits | None]:
        if axis is None:
            return np.empty(0), None
        steps = np.diff(axis.values)
        if not (steps > 0).all():
            k = int(np.argmin(steps > 0))
            fault = "the same; remove one of them" if steps[k] == 0 else "in the wrong order; sort all times"
            one, other = (f"{time:g}" for time in axis.values[k : k + 2])
            units = text(axis.attributes, "units")
            raise ConventionError(f"times {k + 1} and {k + 2} ({one} and {other} {units}) are {fault}")
        try:
            return axis.values, TimeUnits.of(axis.attributes, axis.values.tolist())
        except ConventionError as error:
            raise ConventionError(f"coordinate {axis.coordinate}: {error}") from None
