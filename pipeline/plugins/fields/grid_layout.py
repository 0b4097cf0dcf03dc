"""From a grid of east, north and up to the grid of a scene: a plane in metres, or a sphere.

Arrays are (E, N, U) here: along longitude or x, latitude or y, and height. An axis that the data lack stands
as two nodes far apart, with the same velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.cf_conventions import EAST, NORTH, UP, ConventionError

EARTH = 6371e3
"""The mean radius of the earth, metres."""

FLAT, SPHERE, SPHERE_SURFACE, TURNED = range(4)  # as of `Samples`

COLUMNS = 32
"""Nodes along each horizontal axis that are written at once: files have another order than memory."""

Box = tuple[slice, slice, slice]
"""Some nodes along three axes."""

FAR = 1000.0
"""Half the length of an axis that the data lack, in the longest length of the others."""


def mirrored(part: slice, length: int) -> slice:
    """Return where a part of an axis is once the axis is turned."""
    return slice(length - part.stop, length - part.start)


@dataclass(frozen=True)
class Placing:
    """The settings by which a shot places data.

    map         plane or sphere; None is a plane
    up          the axis of the data that points up in pictures; None: z where it is a height, else y
    fit         length of the longer horizontal side, or the diameter of the sphere, scene units; None keeps
                metres, and a radius of 1
    exaggerate  factor on heights and vertical velocities
    land        what missing velocities are: 0, or those beside them without their part across the coast
    """

    map: Literal["plane", "sphere"] | None = None
    up: Literal["y", "z"] | None = None
    fit: float | None = None
    exaggerate: float = 1.0
    land: Literal["stop", "slide"] = "stop"


@dataclass(frozen=True)
class Coordinates:
    """The coordinates of data, each (n,) ascending, or None where the data lack the axis.

    east, north    degrees or metres
    up             metres
    is_geographic  True if east and north are degrees
    is_height      True if `up` is known to be vertical, or they are one level of what has such an axis
    """

    east: Floats | None
    north: Floats | None
    up: Floats | None
    is_geographic: bool
    is_height: bool

    @property
    def is_global(self) -> bool:
        """True if the longitudes go once around, without the first one at the end again."""
        if not self.is_geographic or self.east is None or len(self.east) < 3:
            return False
        step = (self.east[-1] - self.east[0]) / (len(self.east) - 1)
        return bool(abs(self.east[-1] + step - self.east[0] - 360.0) < 0.01 * step)


@dataclass(frozen=True)
class GridLayout:
    """The grid of a scene, and what makes its velocities of those of the data.

    unit  factor from metres to scene units
    """

    coordinates: Coordinates
    placing: Placing
    unit: float = field(init=False)

    def __post_init__(self) -> None:
        here, placing = self.coordinates, self.placing
        if placing.map == "sphere" and not (
            here.is_geographic and here.east is not None and here.north is not None
        ):
            raise ConventionError(
                "its axes are not longitude and latitude in degrees, so it does not fit a sphere; "
                "write map: plane"
            )
        unit = 1.0
        if self.is_round:
            unit = (1.0 if placing.fit is None else 0.5 * placing.fit) / EARTH
        elif placing.fit is not None:
            unit = placing.fit / max(float(np.ptp(axis)) for axis in self.plane)
        object.__setattr__(self, "unit", unit)

    @property
    def is_round(self) -> bool:
        return self.placing.map == "sphere"

    @property
    def geometry(self) -> int:
        if not self.is_round:
            return FLAT
        return SPHERE_SURFACE if self.coordinates.up is None else SPHERE

    @cached_property
    def _columns(self) -> np.ndarray | None:
        """The columns of the data by those of the grid; None where they are the same."""
        if not self.coordinates.is_global:
            return None
        n = len(self.coordinates.east)  # type: ignore[arg-type]
        return np.array([n - 1, *range(n), 0, 1] if self.is_round else [*range(n), 0])

    @cached_property
    def _poles(self) -> tuple[bool, bool]:
        """True where a row is added: at the south pole, and at the north pole."""
        north = self.coordinates.north
        if not (self.is_round and self.coordinates.is_global) or north is None:
            return False, False
        step = 1.5 * float(np.diff(north).max())
        return 0.001 < 90.0 + north[0] <= step, 0.001 < 90.0 - north[-1] <= step

    @cached_property
    def _degrees(self) -> tuple[Floats | None, Floats | None]:
        """Longitudes and latitudes of the grid, degrees, or metres."""
        east, north = self.coordinates.east, self.coordinates.north
        if east is not None and self._columns is not None:
            east = np.concatenate(
                [east[-1:] - 360.0, east, east[:2] + 360.0] if self.is_round else [east, east[:1] + 360.0]
            )
        if north is not None:
            south, top = self._poles
            north = np.concatenate([[-90.0] if south else [], north, [90.0] if top else []])
        return east, north

    @property
    def _middle_latitude(self) -> float:
        north = self.coordinates.north
        return 0.0 if north is None else float(np.radians(0.5 * (north[0] + north[-1])))

    @cached_property
    def plane(self) -> list[Floats]:
        """The horizontal axes of a plane in metres, the middle at 0 where they were degrees or are fitted."""
        axes = []
        narrow = np.cos(self._middle_latitude)
        for values, factor in zip(self._degrees, (narrow, 1.0), strict=True):
            if values is None:
                continue
            middle = 0.5 * (values[0] + values[-1])
            if self.coordinates.is_geographic:
                axes.append(EARTH * factor * np.radians(values - middle))
            else:
                axes.append(values - middle if self.placing.fit is not None else values)
        return axes or [np.array([0.0, 1.0])]

    @cached_property
    def _scene(self) -> tuple[Floats, Floats, Floats]:
        """The axes east, north and up of the grid in scene units; of a sphere radians and radii."""
        here, height = self.coordinates, self.coordinates.up
        if self.is_round:
            east, north = self._degrees
            heights = np.array([-0.5, 0.5]) * EARTH if height is None else self.placing.exaggerate * height
            radii = self.unit * (EARTH + heights)
            if radii[0] <= 0.0:
                raise ConventionError("exaggerate puts its depths beyond the middle of the sphere; lower it")
            return np.radians(east), np.radians(north), radii  # type: ignore[arg-type]
        horizontal = iter(self.plane)
        given = [
            None if here.east is None else next(horizontal),
            None if here.north is None else next(horizontal),
            None if height is None else self.placing.exaggerate * height,
        ]
        longest = max(float(np.ptp(axis)) for axis in given if axis is not None)
        slab = FAR * longest * np.array([-1.0, 1.0])
        east, north, up = (self.unit * (slab if axis is None else axis) for axis in given)
        return east, north, up

    @property
    def is_upright(self) -> bool:
        """True if the vertical axis of the data points up in pictures."""
        if self.placing.up is not None:
            return self.placing.up == "z"
        return self.coordinates.is_height

    def is_above(self, other: GridLayout) -> bool:
        """Tell whether a plane has its places where another has them, whatever their heights."""
        return len(self.plane) == len(other.plane) and all(
            len(one) == len(two) and np.allclose(one, two, rtol=1e-6, atol=1e-6 * np.ptp(one))
            for one, two in zip(self.plane, other.plane, strict=True)
        )

    @cached_property
    def axes(self) -> tuple[Floats, Floats, Floats]:
        """The axes of the scene; of a sphere longitude, latitude (radians) and distance from its middle."""
        east, north, up = map(np.ascontiguousarray, self._scene)
        if not self.is_round and self.is_upright:
            return east, up, np.ascontiguousarray(-north[::-1])
        return east, north, up

    @cached_property
    def spacing(self) -> float:
        """The shortest length over which velocities vary, scene units."""
        here, (east, north, up) = self.coordinates, self._scene
        size = up[0] if self.is_round else 1.0
        lengths = [size * np.diff(east).min()] if here.east is not None else []
        lengths += (
            [size * np.diff(north[1:-1] if self.is_round and len(north) > 3 else north).min()]
            if here.north is not None
            else []
        )
        lengths += [np.diff(up).min()] if here.up is not None else []
        return float(min(lengths))

    def metric(self, axis: int) -> Floats:
        """Return distances of neighbours along an axis of `axes`, to be broadcast to theirs (X, Y, Z)."""
        steps = np.diff(self.axes[axis])
        if not self.is_round:
            return steps.reshape([-1 if k == axis else 1 for k in range(3)])
        _, north, radii = self._scene
        if axis == 2:
            return steps[None, None, :]
        if axis == 1:
            return steps[None, :, None] * radii
        across = steps.min() * np.cos(north)[None, :, None] * radii
        return np.where(across > 1e-9 * across.max(), across, np.inf)

    def empty(self) -> np.ndarray:
        """Return float32 velocities (X, Y, Z, 3) in C order, all 0."""
        return np.zeros((*map(len, self.axes), 3), np.float32)

    @property
    def is_plain(self) -> bool:
        """True if it is a plane with the nodes of the data, as they are."""
        return not self.is_round and self._columns is None

    def in_scene(self, parts: Sequence[list[slice]]) -> tuple[list[slice], ...]:
        """Return parts of the axes E, N and U as parts of the axes of a plane."""
        east, north, up = parts
        if not self.is_upright:
            return east, north, up
        return east, up, [mirrored(part, len(self.axes[2])) for part in reversed(north)]

    def in_data(self, box: Box) -> Box:
        """Return nodes (X, Y, Z) of a plane as nodes (E, N, U), or reversed axes as these."""
        x, y, z = box
        return (x, mirrored(z, len(self.axes[2])), y) if self.is_upright else box

    def fill(
        self,
        out: np.ndarray,
        place: Box,
        components: Mapping[str, np.ndarray],
        missing: np.ndarray | None,
        is_angular: bool,
    ) -> None:
        """Write velocities, scene units per second, to some nodes of `empty`.

        place       the nodes (E, N, U) of the data that `components` have; all but of U, except on a plane
                    whose columns are those of the data
        components  of the data by `x`, `y` and `z`, float32 (E, N, U), 0 where they are missing; in m/s, or
                    where `is_angular` the first two in radians per second
        missing     bool (E, N, U); None where there are all
        """
        if missing is not None and self.placing.land == "slide":
            components = _sliding(components, missing, self._cell_sizes)
        columns = self._columns
        if columns is not None:
            components = {axis: np.take(values, columns, axis=0) for axis, values in components.items()}
        if self.is_round:
            self._fill_sphere(out[:, :, place[2]], place[2], components, is_angular)
        else:
            seen = out.transpose(0, 2, 1, 3)[:, ::-1] if self.is_upright else out
            self._fill_plane(seen[place], place[1], components, is_angular)

    def fill_numbers(self, out: np.ndarray, layers: slice, values: np.ndarray, known: np.ndarray) -> None:
        """Write numbers to some layers of `empty`: the value where it is known, 1 where it is, and 1.

        values  (E, N, U), 0 where they are missing
        known   (E, N, U), 1 where they are not, else 0
        """
        numbers = np.stack([values, known, np.ones_like(values)], axis=-1)
        if self._columns is not None:
            numbers = np.take(numbers, self._columns, axis=0)
        if not self.is_round:
            seen = out.transpose(0, 2, 1, 3)[:, ::-1] if self.is_upright else out
            seen[:, :, layers] = numbers
            return
        south, top = self._poles
        part = out[:, :, layers]
        part[:, int(south) : out.shape[1] - int(top)] = numbers
        self._fill_poles(part)

    @property
    def _cell_sizes(self) -> tuple[float, float, float]:
        here, (east, north, up) = self.coordinates, self._scene
        size = float(up[-1]) if self.is_round else 1.0
        sizes = [
            size * float(np.diff(east).mean()),
            size * float(np.diff(north).mean()),
            float(np.diff(up).mean()),
        ]
        given = (here.east, here.north, here.up)
        return tuple(size if axis is not None else np.inf for size, axis in zip(sizes, given, strict=True))  # type: ignore[return-value]

    def _fill_plane(
        self, out: np.ndarray, rows: slice, components: Mapping[str, np.ndarray], is_angular: bool
    ) -> None:
        """Write velocities to (E, N, U, 3), whose second axis has some rows of the data."""
        upright = self.is_upright
        wider: np.ndarray = np.ones((out.shape[1], 1), np.float32)
        if self.coordinates.is_geographic and self.coordinates.north is not None:
            cosine, middle = np.cos(np.radians(self.coordinates.north)), np.cos(self._middle_latitude)
            wider = (
                np.full(len(cosine), middle)
                if is_angular
                else np.where(cosine > 1e-3, middle / np.maximum(cosine, 1e-3), 0.0)
            )
            wider = wider[rows, None].astype(np.float32)
        metres = np.float32(self.unit * (EARTH if is_angular else 1.0))
        places = {EAST: 0, NORTH: 2, UP: 1} if upright else {EAST: 0, NORTH: 1, UP: 2}
        factors: dict[str, Any] = {
            EAST: metres * wider,
            NORTH: -metres if upright else metres,
            UP: np.float32(self.unit * self.placing.exaggerate),
        }
        for at in np.ndindex(*(-(-length // COLUMNS) for length in out.shape[:2])):
            east, north = (slice(COLUMNS * k, COLUMNS * (k + 1)) for k in at)
            for axis, values in components.items():
                factor = factors[axis][north] if axis == EAST else factors[axis]
                np.multiply(values[east, north], factor, out=out[east, north, :, places[axis]])

    def _fill_sphere(
        self, out: np.ndarray, layers: slice, components: Mapping[str, np.ndarray], is_angular: bool
    ) -> None:
        """Write velocities to (E, N, U, 3), and to the poles the mean of those around."""
        east, north, radii = self._scene
        radii = radii[layers]
        south, top = self._poles
        rows = slice(int(south), len(north) - int(top))
        along = (radii if is_angular else radii / EARTH).astype(np.float32)
        turn, tilt = east[:, None, None], north[rows][:, None]
        directions = {
            EAST: (np.cos(turn), 0.0 * turn, -np.sin(turn)),
            NORTH: (-np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0.0 * turn, -np.sin(tilt) * np.cos(turn)),
            UP: (np.cos(tilt) * np.sin(turn), np.sin(tilt) + 0.0 * turn, np.cos(tilt) * np.cos(turn)),
        }
        factors: dict[str, Any] = {
            EAST: along * np.cos(tilt).astype(np.float32) if is_angular else along,
            NORTH: along,
            UP: np.float32(self.unit * self.placing.exaggerate),
        }
        inside = out[:, rows]
        for axis, values in components.items():
            speed = values * factors[axis]
            for k, direction in enumerate(directions[axis]):
                inside[..., k] += speed * direction.astype(np.float32)
        self._fill_poles(out)

    def _fill_poles(self, out: np.ndarray) -> None:
        """Write to the poles of (E, N, U, 3) the mean of those around."""
        south, top = self._poles
        north = self._scene[1]
        for row, near, is_pole in ((0, 1, south), (-1, -2, top)) if self.coordinates.is_global else ():
            if is_pole or abs(abs(north[row]) - 0.5 * np.pi) < 1e-6:
                ring = out[1:-2, near if is_pole else row]
                out[:, row] = ring.mean(axis=0, dtype=np.float64)


def _sliding(
    components: Mapping[str, np.ndarray], missing: np.ndarray, sizes: tuple[float, float, float]
) -> dict[str, np.ndarray]:
    """Return components with those of missing nodes beside others: their mean along the coast.

    The coast is across the gradient of what is missing, by differences of neighbours. Other missing nodes are
    0, so that nothing is carried far inland.
    """
    shape, present = missing.shape, ~missing
    count, normal = np.zeros(shape, np.float32), [np.zeros(shape, np.float32) for _ in range(3)]
    sums = {axis: np.zeros(shape, np.float32) for axis in components}
    for k, step in ((k, step) for k in range(3) for step in (1, -1) if shape[k] > 1):
        here, there = [slice(None)] * 3, [slice(None)] * 3
        here[k], there[k] = (
            (slice(None, -1), slice(1, None)) if step > 0 else (slice(1, None), slice(None, -1))
        )
        near = present[tuple(there)].astype(np.float32)
        count[tuple(here)] += near
        normal[k][tuple(here)] += step * near / np.float32(sizes[k])
        for axis, values in components.items():
            sums[axis][tuple(here)] += near * values[tuple(there)]
    length = np.sqrt(sum(part * part for part in normal))
    coast = missing & (count > 0)
    unit = [np.where(length > 0, part / np.maximum(length, 1e-30), 0.0).astype(np.float32) for part in normal]
    mean = {axis: total / np.maximum(count, 1.0) for axis, total in sums.items()}
    across = sum(mean[axis] * unit["xyz".index(axis)] for axis in mean)
    return {
        axis: np.where(coast, mean[axis] - across * unit["xyz".index(axis)], values)
        for axis, values in components.items()
    }
