"""Grids whose longitudes and latitudes have two dimensions, as of ocean models, put on even ones (CF §5.2).

Each cell is two triangles, in which velocities are linear. The new grid has even distances in degrees.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.cf_conventions import EAST, NORTH, ConventionError, text
from flowsculpt.pipeline.plugins.fields.simplex_resampling import EvenGrid, Shares, shares_of

FINER = 1.5
"""Nodes of the new grid along its longer side, over those of the file, where a shot names no number."""

LARGEST = 2048
"""The most of these, where a shot names none."""

_WIDEST = 90.0  # degrees of longitude from corner to corner, from which on a triangle is at a pole

_NAMES = {
    EAST: ("lon", "longitude", "nav_lon", "lon_rho", "tlong", "tlon", "xlong", "geolon", "glamt", "xlon"),
    NORTH: ("lat", "latitude", "nav_lat", "lat_rho", "tlat", "ulat", "xlat", "geolat", "gphit", "ylat"),
}

Along = Literal["east", "grid"]
"""Whether components go east and north, or along the lines of the grid."""


def two_dimensional(variables: Mapping[str, Any], variable: Any) -> tuple[str, str] | None:
    """Return the names of longitudes and latitudes of two dimensions of a variable; None without them.

    Raises ConventionError where there are several.
    """
    named = [name for name in text(variable.attrs, "coordinates").split() if name in variables]
    found: dict[str, list[str]] = {EAST: [], NORTH: []}
    for name in named or list(variables):
        coordinate = variables[name]
        if len(coordinate.dims) != 2 or not set(coordinate.dims) <= set(variable.dims):
            continue
        standard = text(coordinate.attrs, "standard_name")
        for axis, known in (("x", "longitude"), ("y", "latitude")):
            if standard == known or (not standard and str(name).lower() in _NAMES[axis]):
                found[axis].append(str(name))
    if not (found[EAST] and found[NORTH]):
        return None
    if len(found[EAST]) > 1 or len(found[NORTH]) > 1:
        listed = ", ".join((*found[EAST], *found[NORTH]))
        raise ConventionError(
            f"several coordinates may be its longitudes and latitudes: {listed}; name two of them in its "
            "attribute coordinates"
        )
    return found[EAST][0], found[NORTH][0]


def direction_of(name: str, attributes: Mapping[str, Any]) -> Along:
    """Return what a component goes along, by its standard name.

    Raises ConventionError where that does not say it.
    """
    words = set(text(attributes, "standard_name").split("_"))
    if words & {"eastward", "northward", "upward", "downward"}:
        return "east"
    if words & {"x", "y"}:
        return "grid"
    raise ConventionError(
        f"{name} is on a curvilinear grid, and nothing says whether it goes east and north, or along the "
        "lines of the grid. Write along: east, or along: grid"
    )


@dataclass(frozen=True)
class CurvilinearGrid:
    """Longitudes and latitudes of two dimensions, and an even grid in their place.

    longitudes, latitudes  (I, J) degrees
    resolution             nodes along the longer side of the even grid; None: FINER times those of the file
    along                  what components go along
    """

    longitudes: Floats = field(repr=False)
    latitudes: Floats = field(repr=False)
    resolution: int | None = None
    along: Along = "east"

    def __post_init__(self) -> None:
        if min(self.longitudes.shape) < 2:
            raise ConventionError("its grid of longitudes and latitudes has one row; it needs two or more")
        if not (np.isfinite(self.longitudes).all() and np.isfinite(self.latitudes).all()):
            raise ConventionError("its longitudes or latitudes have missing values; give it all of them")
        if np.abs(self.latitudes).max() > 90.0 + 1e-6:
            raise ConventionError(f"latitude {np.abs(self.latitudes).max():g} is beyond a pole; correct it")

    @cached_property
    def _unwrapped(self) -> Floats:
        """Longitudes without jumps along rows; (I, J)."""
        return np.asarray(np.unwrap(np.unwrap(self.longitudes, axis=0, period=360.0), axis=1, period=360.0))

    @property
    def _is_global(self) -> bool:
        """True if the grid goes around: no gap of longitudes is much wider than its cells."""
        places = np.sort(np.mod(self.longitudes.ravel(), 360.0))
        gaps = np.append(np.diff(places), places[0] + 360.0 - places[-1])
        return bool(gaps.max() < 3.0 * 360.0 / max(self.longitudes.shape))

    @cached_property
    def grid(self) -> EvenGrid:
        """The even grid, by longitude and latitude."""
        longest = self.resolution or min(LARGEST, round(FINER * max(self.longitudes.shape)))
        south, north = float(self.latitudes.min()), float(self.latitudes.max())
        if not self._is_global:
            lows = np.array([self._unwrapped.min(), south])
            return EvenGrid.around(lows, np.array([self._unwrapped.max(), north]), longest)
        found = EvenGrid.around(np.array([-180.0, south]), np.array([180.0, north]), longest + 1)
        return EvenGrid(found.origin, found.spacing, (found.shape[0] - 1, found.shape[1]))

    @cached_property
    def _points(self) -> Floats:
        """Places (N, 2) of the file's nodes; of a global grid three times, 360 degrees apart."""
        east = np.mod(self.longitudes + 180.0, 360.0) - 180.0 if self._is_global else self._unwrapped
        points = np.column_stack([east.ravel(), self.latitudes.ravel()])
        if not self._is_global:
            return points
        around = np.array([360.0, 0.0])
        return np.concatenate([points, points + around, points - around])

    @cached_property
    def _triangles(self) -> np.ndarray:
        """Numbers (T, 3) of `_points`."""
        numbers = np.arange(self.longitudes.size, dtype=np.int32).reshape(self.longitudes.shape)
        a, b, c, d = (
            part.ravel() for part in (numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:])
        )
        triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        east, count = self._points[:, 0], self.longitudes.size
        if self._is_global:
            versions = []
            for anchor in range(3):  # a triangle across the seam lies at both of its ends
                turns = np.round((east[triangles[:, [anchor]]] - east[triangles]) / 360.0).astype(np.int32)
                here = triangles + count * np.mod(turns, 3)
                versions.append(here if not anchor else here[turns.any(axis=1)])
            triangles = np.concatenate(versions)
        return triangles[np.ptp(east[triangles], axis=1) < _WIDEST]

    @cached_property
    def _shares(self) -> Shares:
        content = hashlib.sha256(self._points.tobytes() + self._triangles.tobytes()).hexdigest()
        found = shares_of(self._points, self._triangles, self.grid, content)
        return Shares(found.nodes, found.corners % self.longitudes.size, found.shares)

    @cached_property
    def _turn(self) -> tuple[Floats, Floats]:
        """Cosine and sine (I, J, 1) of the angle from east to the first direction of the grid."""
        east = np.gradient(self._unwrapped, axis=0) * np.cos(np.radians(self.latitudes))
        angle = np.arctan2(np.gradient(self.latitudes, axis=0), east)[:, :, None]
        return np.cos(angle), np.sin(angle)

    def eastward(self, components: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return components (I, J, U) of which the first two go east and north."""
        if self.along == "east":
            return dict(components)
        cosine, sine = self._turn
        one, other = components[EAST], components[NORTH]
        turned = {EAST: one * cosine - other * sine, NORTH: one * sine + other * cosine}
        return dict(components) | {axis: values.astype(np.float32) for axis, values in turned.items()}

    def resampled(
        self, components: Mapping[str, np.ndarray], missing: np.ndarray | None
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Return components (E, N, U) of the even grid, 0 where they are missing, and where they are.

        A node is missing where it is outside of all cells, or where missing ones have more than half of it.
        """
        shape, count = self.grid.shape, math.prod(self.grid.shape)
        layers = next(iter(components.values())).shape[2]
        present = np.ones((self.longitudes.size, layers), np.float32)
        if missing is not None:
            present -= missing.reshape(present.shape)
        shares = self._shares.of(present, count)
        lacking = ~(shares >= 0.5).reshape(*shape, layers)
        out = {}
        for axis, values in self.eastward(components).items():
            out[axis] = np.nan_to_num(self._shares.of(values.reshape(-1, layers), count)).reshape(
                *shape, layers
            )
            out[axis][lacking] = 0.0
        return out, lacking

    def error(self, components: Mapping[str, np.ndarray], missing: np.ndarray | None) -> float:
        """Return the rms error of resampled components at the file's own nodes, over their rms.

        Nodes beside missing ones, or at the border, do not count.
        """
        out, lacking = self.resampled(components, missing)
        points = self._points[: self.longitudes.size]
        near = self.grid.interpolated(lacking[:, :, :1].astype(np.float32), points)[:, 0] < 1e-6
        squares = total = 0.0
        for axis, values in self.eastward(components).items():
            own = values[:, :, 0].reshape(-1)[near].astype(np.float64)
            squares += float(
                ((self.grid.interpolated(out[axis][:, :, :1], points)[near, 0] - own) ** 2).sum()
            )
            total += float((own**2).sum())
        return math.sqrt(squares / total) if total else 0.0


def shared_grid(grids: Mapping[str, CurvilinearGrid | None]) -> CurvilinearGrid:
    """Return the grid of all components, `x`, `y` and maybe `z`. Raises ConventionError where they differ."""
    first = next(grid for grid in grids.values() if grid is not None)
    horizontal = {grid.along for axis in (EAST, NORTH) if (grid := grids.get(axis)) is not None}
    if len(horizontal) > 1 or not {EAST, NORTH} <= grids.keys():
        raise ConventionError("one component goes along the grid and the other does not. Write along: east")
    for grid in grids.values():
        if grid is None or not (
            np.array_equal(grid.longitudes, first.longitudes)
            and np.array_equal(grid.latitudes, first.latitudes)
        ):
            raise ConventionError(
                "its components are at different places, as on a staggered grid; interpolate them to one "
                "grid first, for example with xgcm or cdo"
            )
    return replace(first, along=horizontal.pop())
