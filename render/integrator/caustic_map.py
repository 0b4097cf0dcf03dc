"""Caustics behind the first surface: on matt surfaces that the lens sees in mirrors, through glass or by the
light that other matt surfaces reflect.

A path that leaves such a surface meets the sun by way of glass once in many thousand times, and then it is a
firefly. Photons that land nearby bring the same light with little noise (Jensen, *Realistic Image Synthesis
Using Photon Mapping*, 2001). They are counted in cells of a grid, the narrower the more of them land; a place
gets the irradiance of a cell at random beside it, so that no edges of cells show. That blurs a caustic by the
width of a cell, where the lens does not see it itself (for that see `caustic_picture`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned_columns

CELLS_PER_RADIUS, CELLS_PER_AXIS = 64, 1024
"""Finest cells along the radius of the sphere around all mirrors and glass, and along each axis of the grid
around its middle."""

LEVELS = 4
"""Widths of cells, each twice the one before; the widest are blocks."""

LEAST_PHOTONS = 16
"""Least photons of a cell. Fewer belong to the wider cell around it, and a block may have any number."""

TILTED_AREA = 0.94
"""Area of a surface in a cell, over that of one along two axes: from 0.93 to 0.95 by its tilt, as an average
over cells at random beside its places (by numbers)."""

_SHIFT = 0.37
"""Offset of the grid, in finest cells, which keeps floors off the faces of cells."""

_SIDE = 1 << (LEVELS - 1)
_BLOCKS = CELLS_PER_AXIS // _SIDE
_DIVIDED = 1 << 31
"""Set in the entries of blocks that are divided into cells; others have one value."""


@dataclass(frozen=True, eq=False)
class CausticMap:
    """Irradiance by caustics in cells of a grid.

    middle       of the grid, scene units
    rate         finest cells per scene unit
    blocks       numbers of their values, or _DIVIDED and the number of the division
    divisions    numbers of the values of finest cells, _SIDE³ for each divided block
    widths       of the cells with each value, scene units; value 0 is that of empty blocks
    directions   unit vectors to where most of the light comes from, by values
    irradiances  by values and light groups, of surfaces along two axes
    groups       number of light groups
    """

    middle: Any
    rate: Any
    blocks: Any
    divisions: Any
    widths: Any
    directions: Any
    irradiances: Any
    groups: int

    @classmethod
    def of(
        cls,
        sphere: tuple[Any, Any],
        places: NDArray[np.float32],
        directions: NDArray[np.float32],
        light: NDArray[np.float64],
    ) -> CausticMap:
        """Return the map of P photons.

        sphere      middle and radius of that around all mirrors and glass, scene units
        places      (P, 3) where photons land, scene units
        directions  (P, 3) unit vectors to where they come from
        light       (P, 3 · groups) of each
        """
        middle, radius = np.array(sphere[0], dtype=np.float64).ravel(), float(sphere[1][0])
        rate = CELLS_PER_RADIUS / radius
        cells = np.floor((places - middle) * rate + (CELLS_PER_AXIS // 2 + _SHIFT)).astype(np.int64)
        inside = ((cells >= 0) & (cells < CELLS_PER_AXIS)).all(axis=1)
        aims = directions * light.sum(axis=1, keepdims=True)
        table = _Table.of(cells[inside], np.concatenate([light, aims], axis=1)[inside])
        aims = table.sums[:, -3:]
        aims /= np.maximum(np.linalg.norm(aims, axis=1, keepdims=True), 1e-30)
        irradiance = (table.sums[:, :-3] * rate**2).reshape(-1, 3)
        return cls(
            sphere[0],
            dr.opaque(mi.Float, rate),
            mi.UInt32(table.blocks),
            mi.UInt32(table.divisions),
            mi.Float((table.widths / rate).astype(np.float32)),
            mi.Vector3f(*aligned_columns(aims.astype(np.float32))),
            mi.Color3f(*aligned_columns(irradiance.astype(np.float32))),
            light.shape[1] // 3,
        )

    def reaches(self, place: Any) -> Any:
        """Tell whether a place is in the grid."""
        cell = self._cell(place)
        return dr.all((cell >= 0) & (cell < CELLS_PER_AXIS))

    def reflected(self, si: Any, bsdf: Any, numbers: Any, active: Any) -> list[Any]:
        """Return the light of caustics that surfaces reflect along their paths, by light group.

        numbers  two at random from 0 to 1
        active   False outside the grid too
        """
        frame, (u, v) = mi.Frame3f(si.n), numbers - 0.5
        width = dr.gather(mi.Float, self.widths, self._value(si.p, active), active)
        value = self._value(si.p + (frame.s * u + frame.t * v) * width, active)
        direction = si.to_local(dr.gather(mi.Vector3f, self.directions, value, active))
        lit = active & (value > 0) & (direction.z > 1e-3)
        factor = bsdf.eval(mi.BSDFContext(), si, direction, lit) / direction.z
        factor /= dr.select(dr.max(dr.abs(si.n)) > 0.999, 1.0, TILTED_AREA)
        first = value * self.groups
        return [
            dr.select(lit, factor * dr.gather(mi.Color3f, self.irradiances, first + group, lit), 0.0)
            for group in range(self.groups)
        ]

    def _cell(self, place: Any) -> Any:
        """Return the indices of the finest cell of a place; outside the grid some are negative or too
        large."""
        return mi.Vector3i(dr.floor((place - self.middle) * self.rate + (CELLS_PER_AXIS // 2 + _SHIFT)))

    def _value(self, place: Any, active: Any) -> Any:
        """Return the number of the value at a place, 0 where no photon landed."""
        cell = mi.Vector3u(dr.clip(self._cell(place), 0, CELLS_PER_AXIS - 1))
        entry = dr.gather(mi.UInt32, self.blocks, _number(cell // _SIDE, _BLOCKS), active)
        is_divided = (entry & _DIVIDED) != 0
        within = (entry & (_DIVIDED - 1)) * _SIDE**3 + _number(cell & (_SIDE - 1), _SIDE)
        divided = active & is_divided
        return dr.select(is_divided, dr.gather(mi.UInt32, self.divisions, within, divided), entry)


def _number(cell: Any, side: int) -> Any:
    """Return the numbers of cells in a cube of so many along each side, by their indices x, y, z."""
    x, y, z = cell
    return (x * side + y) * side + z


@dataclass(eq=False)
class _Table:
    """Values of cells.

    blocks     (_BLOCKS³,) as of `CausticMap`
    divisions  (D · _SIDE³,) as of `CausticMap`
    sums       (V, K) of what is counted, over the area of the cells with each value, in that of a finest
    widths     (V,) of these cells, finest ones
    """

    blocks: NDArray[np.uint32]
    divisions: NDArray[np.uint32]
    sums: NDArray[np.float64]
    widths: NDArray[np.int64]

    @classmethod
    def of(cls, cells: NDArray[np.int64], counted: NDArray[np.float64]) -> _Table:
        """Count photons (P, K) in finest cells (P, 3), and share the cells among values.

        From the finest cells to blocks, each cell with enough photons that none within has taken gets a value
        of its own.
        """
        sums, widths = [np.zeros((1, counted.shape[1]))], [np.array([_SIDE])]  # of empty blocks
        valued: list[tuple[NDArray[np.int64], NDArray[np.uint32]]] = []
        left, lit, covered, count = np.ones(len(cells)), np.zeros(len(cells)), np.zeros(len(cells)), 1
        for level in range(LEVELS):
            area = 4.0**level
            cells = cells // min(2, 1 << level)
            _, first, member = np.unique(
                _number(cells.T, CELLS_PER_AXIS), return_index=True, return_inverse=True
            )
            cells, total = cells[first], len(first)
            left, lit, covered = (_sums(each[:, None], member, total)[:, 0] for each in (left, lit, covered))
            lit = np.ones(total) if level == 0 else lit
            counted = _sums(counted, member, total)
            has_value = (left >= LEAST_PHOTONS) | (level == LEVELS - 1)
            lit_area = np.maximum(lit, 1.0)  # a tilted surface is in more cells than its area has
            free = np.maximum(area - covered, lit_area)[has_value]
            sums.append(counted[has_value] / free[:, None])
            widths.append(np.full(len(free), 1 << level))
            valued.append((cells[has_value], np.arange(count, count + len(free), dtype=np.uint32)))
            count += len(free)
            is_divided = covered > 0
            left[has_value], lit[has_value], counted[has_value], covered[has_value] = 0.0, 0.0, 0.0, area
        blocks, divisions = _places(valued, is_divided)
        return cls(blocks, divisions, np.concatenate(sums), np.concatenate(widths))


def _sums(values: NDArray[np.float64], member: NDArray[np.intp], count: int) -> NDArray[np.float64]:
    """Return the sums (count, K) of the values (N, K) of each member's group."""
    sums = np.zeros((count, values.shape[1]))
    for column, total in zip(values.T, sums.T, strict=True):
        total += np.bincount(member, column, count)
    return sums


def _places(
    valued: list[tuple[NDArray[np.int64], NDArray[np.uint32]]], is_divided: NDArray[np.bool_]
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return `blocks` and `divisions` as of `_Table`.

    valued      by level: cells (C, 3) and the numbers (C,) of their values; the last are all blocks with any
    is_divided  (C,) blocks that have values within
    """
    *finer, (cells, values) = valued
    blocks = np.zeros(_BLOCKS**3, np.uint32)
    blocks[_number(cells.T, _BLOCKS)] = values
    divisions = np.repeat(values[is_divided], _SIDE**3).reshape(-1, _SIDE, _SIDE, _SIDE)
    blocks[_number(cells[is_divided].T, _BLOCKS)] = _DIVIDED + np.arange(len(divisions), dtype=np.uint32)
    for level, (cells, values) in reversed(list(enumerate(finer))):
        cells = cells << level
        number = blocks[_number((cells // _SIDE).T, _BLOCKS)] & np.uint32(_DIVIDED - 1)
        x, y, z = (cells % _SIDE).T
        for i, j, k in np.ndindex(*[1 << level] * 3):
            divisions[number, x + i, y + j, z + k] = values
    return blocks, np.append(divisions.ravel(), np.zeros(2, np.uint32))  # never empty
