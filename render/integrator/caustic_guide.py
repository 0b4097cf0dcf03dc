"""Guide paths from matt surfaces to caustics: light that mirrors and glass throw there.

A path that leaves the floor by its BSDF rarely meets glass in a direction that leads on to a softbox, but
then brings much light, which is noise. So a few photons are traced first, from the sampled emitters by way of
mirrors and glass to the first matt surface. They fill a histogram of directions for each cell of a grid, from
which a part of the directions at matt surfaces is sampled (Jensen, *Importance driven path tracing using the
photon map*, 1995). The rest is sampled by the BSDF and both are weighted as one density, so that the guide
changes the noise alone, never the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned_columns
from flowsculpt.render.integrator.photons import Photons

LEVELS = (1, 2, 4, 8)
"""Widths of cells, in those of the finest. A place belongs to the finest cell that has enough photons."""

CELLS_PER_RADIUS = 16
"""Finest cells along the radius of the sphere around all mirrors and glass."""

MAX_DISTANCE = 8
"""Distance from the middle of that sphere to which the grid reaches, in radii."""

MIN_PHOTONS = 32
"""Least photons of a cell."""

SIDE = 32
"""Rows and columns of a histogram."""

MAX_FRACTION = 0.85
"""Fraction of the directions in a cell that its histogram gives where the caustic is all the light."""

HALF_IRRADIANCE = 0.03
"""Irradiance by the caustic that brings the fraction half way, in that of the emitters on the mirrors and
glass."""

_BINS = SIDE * SIDE
_NONE = 0xFFFFFFFF
_SLOTS_PER_CELL = 16
_SHIFT = 0.37
"""Offset of the grid, in finest cells, which keeps floors off the faces of cells."""


def guide_of(photons: Photons) -> CausticGuide | None:
    """Return the guide by photons, or None where they make no caustic."""
    photons = photons.within(MAX_DISTANCE * photons.radius)
    if len(photons.weights) < MIN_PHOTONS:
        return None
    cells = _cells(photons)
    return CausticGuide.of(photons, *cells) if len(cells[0]) else None


@dataclass(frozen=True, eq=False)
class CausticGuide:
    """Histograms of the directions from which caustics shine, by cells of a grid.

    middle      of the grid, scene units
    rate        finest cells per scene unit
    mask        bits of a slot's number in a hash table
    keys        of the cells, by slots
    cells       their numbers, by slots
    cumulative  probabilities of the bins of each cell, summed from the first bin on
    fractions   of the directions that are sampled by the histogram, by cells
    """

    middle: Any
    rate: Any
    mask: Any
    keys: Any
    cells: Any
    cumulative: Any
    fractions: Any

    @classmethod
    def of(
        cls, photons: Photons, keys: NDArray[np.uint32], bins: NDArray[np.float64], light: NDArray[np.float64]
    ) -> CausticGuide:
        """Return the guide of cells in order of their photons, from the fewest.

        keys   (C,) of the cells
        bins   (C, SIDE²) light of the photons of each cell by direction
        light  (C,) irradiance of each cell by the caustic, over that of the emitters
        """
        cumulative = np.cumsum(bins, axis=1)
        cumulative /= cumulative[:, -1:]
        slots = 1 << int(len(keys) * _SLOTS_PER_CELL - 1).bit_length()
        table, numbers = np.full(slots, _NONE, np.uint32), np.full(slots, _NONE, np.uint32)
        slot = _hash(keys) & np.uint32(slots - 1)
        # Of cells that share a slot the last stays; the places of others belong to coarser cells.
        table[slot], numbers[slot] = keys, np.arange(len(keys), dtype=np.uint32)
        share = light / (light + HALF_IRRADIANCE)
        fractions = MAX_FRACTION * share
        guide = cls(
            mi.Point3f(photons.middle),
            mi.Float(CELLS_PER_RADIUS / photons.radius),
            mi.UInt32(slots - 1),
            mi.UInt32(table),
            mi.UInt32(numbers),
            mi.Float(cumulative.astype(np.float32).ravel()),
            mi.Float(fractions.astype(np.float32)),
        )
        dr.make_opaque(guide.middle, guide.rate, guide.mask)
        return guide

    def cell(self, place: Any, active: Any) -> tuple[Any, Any]:
        """Return the number of the cell of a place, and the fraction of directions to sample by it: 0 where
        no cell is."""
        found = mi.UInt32(_NONE)
        for level in range(len(LEVELS) - 1, -1, -1):
            key = _key((place - self.middle) * self.rate, level)
            slot = _hash(key) & self.mask
            here = active & (dr.gather(mi.UInt32, self.keys, slot, active) == key)
            found = dr.select(here, dr.gather(mi.UInt32, self.cells, slot, here), found)
        fraction = dr.gather(mi.Float, self.fractions, found, found != _NONE)
        return found, fraction

    def sample(self, cell: Any, numbers: Any, active: Any) -> Any:
        """Return a direction of a cell, by two numbers from 0 to 1."""
        first = cell * _BINS
        cumulative = self.cumulative
        number: Any = dr.binary_search(  # type: ignore[no-untyped-call]  # Dr.Jit has no type for it
            0, _BINS - 1, lambda index: dr.gather(mi.Float, cumulative, first + index, active) <= numbers.x
        )
        below, above = self._bounds(cell, number, active)
        across = dr.clip((numbers.x - below) / (above - below), 0.0, 1.0)
        row = number // SIDE
        return _to_direction((number - row * SIDE + across) / SIDE, (row + numbers.y) / SIDE)

    def pdf(self, cell: Any, direction: Any, active: Any) -> Any:
        """Return the density of a direction in a cell."""
        across, down, density = _to_square(direction)
        column, row = (dr.minimum(mi.UInt32(part * SIDE), SIDE - 1) for part in (across, down))  # also of NaN
        below, above = self._bounds(cell, row * SIDE + column, active)
        return (above - below) * _BINS * density

    def _bounds(self, cell: Any, number: Any, active: Any) -> tuple[Any, Any]:
        """Return the cumulative probabilities before and after a bin."""
        index = cell * _BINS + number
        below = dr.gather(mi.Float, self.cumulative, index - 1, active & (number > 0))
        return below, dr.gather(mi.Float, self.cumulative, index, active)


class GuidedBsdf:
    """A BSDF with a part of its directions sampled by a guide, at one vertex of each path.

    Elsewhere than on matt surfaces with a cell it is the BSDF alone.
    """

    def __init__(self, guide: CausticGuide, si: Any, bsdf: Any, active: Any) -> None:
        self._guide, self._bsdf, self._flags = guide, bsdf, bsdf.flags()
        is_matt = mi.has_flag(self._flags, mi.BSDFFlags.Diffuse) & ~mi.has_flag(
            self._flags, mi.BSDFFlags.Delta
        )
        self._cell, self._fraction = guide.cell(si.p, active & is_matt)

    def flags(self) -> Any:
        """Return Mitsuba's flags of the BSDF."""
        return self._flags

    def eval(self, context: Any, si: Any, direction: Any, active: Any) -> Any:
        """Return the BSDF times the cosine."""
        return self._bsdf.eval(context, si, direction, active)

    def eval_pdf(self, context: Any, si: Any, direction: Any, active: Any) -> tuple[Any, Any]:
        """Return the BSDF times the cosine, and the density of a local direction."""
        value, density = self._bsdf.eval_pdf(context, si, direction, active)
        return value, self._mix(si, direction, density, active)

    def sample(self, context: Any, si: Any, lobe: Any, direction: Any, active: Any) -> tuple[Any, Any, Any]:
        """Return a sample, its weight, and the weight that it would have without the guide."""
        is_guided = active & (self._fraction > 0.0)
        is_taken = is_guided & (lobe < self._fraction)
        lobe = (lobe - self._fraction) / (1.0 - self._fraction)
        sampled, weight = self._bsdf.sample(context, si, dr.maximum(lobe, 0.0), direction, active & ~is_taken)
        guided = si.to_local(self._guide.sample(self._cell, direction, is_taken))
        sampled.wo = dr.select(is_taken, guided, sampled.wo)
        sampled.eta = dr.select(is_taken, 1.0, sampled.eta)
        kind = mi.UInt32(int(mi.BSDFFlags.DiffuseReflection))
        sampled.sampled_type = dr.select(is_taken, kind, sampled.sampled_type)
        value, density = self._bsdf.eval_pdf(context, si, sampled.wo, is_guided)
        alone = dr.select(is_guided, dr.select(density > 0.0, value / density, 0.0), weight)
        mixed = self._mix(si, sampled.wo, density, is_guided)
        sampled.pdf = dr.select(is_guided, mixed, sampled.pdf)
        weight = dr.select(is_guided, dr.select(mixed > 0.0, value / mixed, 0.0), weight)
        return sampled, weight, alone

    def _mix(self, si: Any, direction: Any, density: Any, active: Any) -> Any:
        """Return the density of a local direction by guide and BSDF together."""
        is_guided = active & (self._fraction > 0.0)
        guided = self._guide.pdf(self._cell, si.to_world(direction), is_guided)
        mixed = dr.lerp(density, guided, self._fraction)
        return dr.select(is_guided, mixed, density)


def _cells(photons: Photons) -> tuple[NDArray[np.uint32], NDArray[np.float64], NDArray[np.float64]]:
    """Return keys, light by direction, and irradiance of all cells, as of `CausticGuide.of`."""
    places = (photons.places - photons.middle) * (CELLS_PER_RADIUS / photons.radius)
    across, down, _ = _to_square(mi.Vector3f(*aligned_columns(photons.directions)))
    place = mi.Point3f(*aligned_columns(places))
    keys_by_level = [_key(place, level) for level in range(len(LEVELS))]
    dr.eval(across, down, keys_by_level)
    columns, rows = (np.minimum(np.array(each) * SIDE, SIDE - 1).astype(np.int64) for each in (across, down))
    bins = rows * SIDE + columns
    parts = [
        _level(np.array(keys), bins, photons.weights, LEVELS[level])
        for level, keys in enumerate(keys_by_level)
    ]
    keys, counts, light, totals = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.argsort(counts, kind="stable")
    area = (photons.radius / CELLS_PER_RADIUS) ** 2
    return keys[order], light[order], totals[order] / (area * photons.irradiance)


def _level(
    keys: NDArray[np.uint32], bins: NDArray[np.int64], weights: NDArray[np.float64], width: int
) -> tuple[NDArray[Any], ...]:
    """Return keys, photons, light by direction, and light per finest cell of the cells of one level.

    keys   (P,) of the cells of photons
    width  of a cell, finest ones
    """
    keys, member, counts = np.unique(keys, return_inverse=True, return_counts=True)
    kept = counts >= MIN_PHOTONS
    number = np.cumsum(kept) - 1
    taken = kept[member]
    index = number[member[taken]] * _BINS + bins[taken]
    summed = np.bincount(index, weights[taken], int(kept.sum()) * _BINS)
    light = np.asarray(summed, dtype=np.float64).reshape(-1, SIDE, SIDE)
    totals = light.sum(axis=(1, 2)) / width**2
    return keys[kept].astype(np.uint32), counts[kept], _blur(light).reshape(-1, _BINS), totals


def _blur(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return histograms with a quarter of each bin's light in either neighbour, along both axes."""
    for axis in (1, 2):
        width = [(1, 1) if each == axis else (0, 0) for each in range(3)]
        padded = np.moveaxis(np.pad(light, width, mode="edge"), axis, 0)
        light = np.moveaxis(0.25 * padded[:-2] + 0.5 * padded[1:-1] + 0.25 * padded[2:], 0, axis)
    return np.ascontiguousarray(light)


def _key(place: Any, level: int) -> Any:
    """Return the key of the cell of a place, by a grid of `LEVELS[level]` finest cells."""
    half = MAX_DISTANCE * CELLS_PER_RADIUS
    x, y, z = (
        mi.UInt32(dr.clip(dr.floor((part + (half + _SHIFT)) / LEVELS[level]), 0, 1023))
        for part in (place.x, place.y, place.z)
    )
    return x | (y << 10) | (z << 20) | mi.UInt32(level << 30)


def _hash(key: Any) -> Any:
    """Return a 32-bit hash of a key, an array of numpy or Dr.Jit (Wellons, 2018)."""
    kind = type(key) if not isinstance(key, np.ndarray) else np.uint32
    key = key ^ (key >> kind(16))
    key = key * kind(0x21F0AAAD)
    key = key ^ (key >> kind(15))
    key = key * kind(0xD35A2D97)
    return key ^ (key >> kind(15))


def _to_direction(across: Any, down: Any) -> Any:
    """Return the direction of a place in the unit square.

    Octahedral map about the vertical, which needs no trigonometry (Cigolle, Donow, Evangelakos, Mara,
    McGuire and Meyer, *A survey of efficient representations for independent unit vectors*, 2014).
    """
    x, z = 2.0 * across - 1.0, 2.0 * down - 1.0
    y = 1.0 - dr.abs(x) - dr.abs(z)
    fold = dr.maximum(-y, 0.0)
    return dr.normalize(mi.Vector3f(x - dr.copysign(fold, x), y, z - dr.copysign(fold, z)))


def _to_square(direction: Any) -> tuple[Any, Any, Any]:
    """Return the place in the unit square of a direction, and the density over directions for a density of 1
    in the square."""
    length = dr.abs(direction.x) + dr.abs(direction.y) + dr.abs(direction.z)
    x, z = direction.x / length, direction.z / length
    is_below = direction.y < 0.0
    folded_x = dr.copysign(1.0 - dr.abs(z), x)
    folded_z = dr.copysign(1.0 - dr.abs(x), z)
    x, z = dr.select(is_below, folded_x, x), dr.select(is_below, folded_z, z)
    return 0.5 * x + 0.5, 0.5 * z + 0.5, dr.rcp(4.0 * length * length * length)
