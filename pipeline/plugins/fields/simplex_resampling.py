"""Values on triangles or tetrahedra, interpolated linearly at the nodes of an even grid.

Which corners a node is between, and their shares, is found once for a grid and kept in the user's cache.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from zipfile import BadZipFile

import numpy as np

from flowsculpt import MachineError, UsageError
from flowsculpt.api.files import CachedAnswer, atomic_write
from flowsculpt.api.meshes import Floats

VERSION = 1
"""Raised when equal cells give other shares."""

MOST_NODES = 1 << 24
"""Nodes of a grid: 512 MiB of corners and shares at most."""

_AT_ONCE = 1 << 20  # pairs of a simplex and a node that are tested together
_SLACK = 1e-6  # how far beyond a face a node still counts as inside, over the height


@dataclass(frozen=True)
class EvenGrid:
    """Nodes at even distances.

    origin   (D,) the first node
    spacing  (D,) distances along the axes
    shape    numbers of nodes along the axes
    """

    origin: Floats
    spacing: Floats
    shape: tuple[int, ...]

    @classmethod
    def around(cls, low: Floats, high: Floats, longest: int) -> EvenGrid:
        """Return a grid from `low` to `high` (D,) with so many nodes along the longest side.

        Raises UsageError where it has more than MOST_NODES.
        """
        size = high - low
        counts = np.maximum(2, np.round(size / size.max() * (longest - 1)).astype(int) + 1)
        if math.prod(counts.tolist()) > MOST_NODES:
            most = int((MOST_NODES / math.prod((size / size.max()).tolist())) ** (1.0 / len(size)))
            raise UsageError(
                f"resolution {longest} makes {' × '.join(map(str, counts))} nodes, which is more than "
                f"{MOST_NODES:,}. Lower it to {most}."
            )
        return cls(np.asarray(low, np.float64), size / (counts - 1), tuple(counts.tolist()))

    @property
    def axes(self) -> list[Floats]:
        return [
            first + step * np.arange(count)
            for first, step, count in zip(self.origin, self.spacing, self.shape, strict=True)
        ]

    def interpolated(self, values: np.ndarray, points: Floats) -> Floats:
        """Return values (N, W) at points (N, D), linear along each axis between those of nodes (…, W)."""
        places = (points - self.origin) / self.spacing
        first = np.clip(places.astype(np.int64), 0, np.array(self.shape) - 2)
        share = np.clip(places - first, 0.0, 1.0)
        out = np.zeros((len(points), values.shape[-1]))
        for corner in product((0, 1), repeat=len(self.shape)):
            weight = np.prod(np.where(corner, share, 1.0 - share), axis=1)
            out += weight[:, None] * values[tuple((first + corner).T)]
        return out


@dataclass(frozen=True)
class Shares:
    """Between which points nodes of a grid are.

    nodes    int64 (M,) numbers of the nodes that are inside, in C order
    corners  int32 (M, D + 1) numbers of points
    shares   float32 (M, D + 1) of each, whose sum is 1
    """

    nodes: np.ndarray
    corners: np.ndarray
    shares: np.ndarray

    def of(self, values: np.ndarray, count: int) -> np.ndarray:
        """Return values (count, W) at all nodes from those at points (N, W); NaN outside.

        A node with a NaN among its corners is NaN too.
        """
        out = np.full((count, values.shape[1]), np.nan, np.float32)
        for first in range(0, len(self.nodes), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            out[self.nodes[part]] = np.einsum("mk,mkw->mw", self.shares[part], values[self.corners[part]])
        return out


def shares_of(points: Floats, simplices: np.ndarray, grid: EvenGrid, digest: str) -> Shares:
    """Return the shares of the nodes of a grid, from the user's cache where they are known.

    points     (N, D)
    simplices  (S, D + 1) numbers of points
    digest     of all that decides points and simplices
    """
    deciding = [str(VERSION), digest, repr((grid.origin.tolist(), grid.spacing.tolist(), grid.shape))]
    path = CachedAnswer.of("field_grids", deciding, ".npz").path
    faults = OSError, ValueError, KeyError, EOFError, BadZipFile
    with suppress(*faults), np.load(path, allow_pickle=False) as kept:
        return Shares(kept["nodes"], kept["corners"], kept["shares"])
    found = _found(points, simplices, grid)
    with suppress(MachineError, OSError), atomic_write(path, flush=False) as draft, draft.open("wb") as file:
        np.savez(file, nodes=found.nodes, corners=found.corners, shares=found.shares)
    CachedAnswer.of("field_grids", deciding).store_alone({"nodes": len(found.nodes)})
    return found


def _found(points: Floats, simplices: np.ndarray, grid: EvenGrid) -> Shares:
    """Test each simplex with the nodes in its box; of several that hold a node the last one counts."""
    count, width = math.prod(grid.shape), simplices.shape[1]
    corners, shares = np.full((count, width), -1, np.int32), np.zeros((count, width), np.float32)
    for part, nodes in _pairs(points, simplices, grid):
        own = simplices[part]
        first = points[own[:, 0]]
        edges = np.moveaxis(points[own[:, 1:]] - first[:, None], 1, 2)
        places = np.stack(np.unravel_index(nodes, grid.shape), axis=1) * grid.spacing + grid.origin - first
        weights = np.linalg.solve(edges, places[:, :, None])[:, :, 0]
        weights = np.column_stack([1.0 - weights.sum(axis=1), weights])
        inside = weights.min(axis=1) >= -_SLACK
        corners[nodes[inside]], shares[nodes[inside]] = own[inside], weights[inside]
    nodes = np.flatnonzero(corners[:, 0] >= 0)
    return Shares(nodes, corners[nodes], shares[nodes])


def _pairs(points: Floats, simplices: np.ndarray, grid: EvenGrid) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield simplices (P,) with a size, and nodes (P,) in their boxes, by their numbers."""
    shape = np.array(grid.shape)
    strides = np.array([int(np.prod(shape[k + 1 :])) for k in range(len(shape))])
    for begin in range(0, len(simplices), _AT_ONCE):
        corners = points[simplices[begin : begin + _AT_ONCE]]
        places = (corners - grid.origin) / grid.spacing
        first = np.maximum(np.ceil(places.min(axis=1) - 1e-9), 0).astype(np.int64)
        last = np.minimum(np.floor(places.max(axis=1) + 1e-9), shape - 1).astype(np.int64)
        many = np.maximum(last - first + 1, 0)
        size = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        counts = np.where(size > 1e-12 * np.prod(grid.spacing), many.prod(axis=1), 0)
        ends = np.cumsum(counts)
        at = 0
        while at < len(counts):
            before = ends[at - 1] if at else 0
            end = max(at + 1, int(np.searchsorted(ends, before + _AT_ONCE, side="right")))
            of = np.repeat(np.arange(at, end), counts[at:end])
            rest = np.arange(len(of)) - (ends[of] - counts[of] - before)
            index = np.zeros(len(of), np.int64)
            for k in reversed(range(len(shape))):
                index += (first[of, k] + rest % many[of, k]) * strides[k]
                rest = rest // many[of, k]
            if len(of):
                yield begin + of, index
            at = end


def spread(values: np.ndarray) -> np.ndarray:
    """Return values (…, W) of a grid; nodes that are NaN get the mean of their neighbours along the axes.

    Without that, points of the border would be blended with 0.
    """
    missing = np.isnan(values[..., 0])
    if not missing.any():
        return values
    total, count = np.zeros_like(values), np.zeros((*missing.shape, 1), np.float32)
    known = np.where(missing[..., None], np.float32(0), values)
    for k in range(missing.ndim):
        for here, there in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
            to, source = [slice(None)] * missing.ndim, [slice(None)] * missing.ndim
            to[k], source[k] = here, there
            total[tuple(to)] += known[tuple(source)]
            count[tuple(to)] += ~missing[tuple(source)][..., None]
    near = missing & (count[..., 0] > 0)
    out = values.copy()
    out[near] = total[near] / count[near]
    return out
