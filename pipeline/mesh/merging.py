"""Merging: coincident vertices of a file become one, and with them its loose triangles one surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.errors import MeshError
from pipeline.mesh.face_soup import FaceSoup
from pipeline.mesh.file_surface import LARGEST_COORDINATE, FileSurface

_MERGE = 1e-9  # of the bounding box's diagonal: closer vertices are one


class MergedSurface(NamedTuple):
    """Faces of a file over merged vertices, each with three different corners at least.

    joined     (V of the file,) the first vertex of the file at the same position
    unused     vertices of the file (K,) that no face names and that lie on no other
    collapsed  faces of the file (L,) with fewer than three corners left, which were dropped
    """

    soup: FaceSoup
    joined: AnyArray
    unused: AnyArray
    collapsed: AnyArray


def merge_coincident(surface: FileSurface) -> MergedSurface:
    """Merge coincident vertices; drop unused ones, and faces with fewer than three corners left.

    Raises MeshError where a face names a vertex whose coordinates are no numbers.
    """
    points, offsets = surface.points, surface.offsets
    named = np.zeros(len(points), bool)
    named[surface.corners] = True
    _require_numbers(surface, named)
    joined = _first_alike(points, named)
    corners, face = joined[surface.corners], np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    following = np.arange(1, len(corners) + 1)
    some = offsets[1:] > offsets[:-1]
    following[offsets[1:][some] - 1] = offsets[:-1][some]
    kept = corners != corners[following]
    sides = np.bincount(face[kept], minlength=len(offsets) - 1)
    whole = sides >= 3
    used, renumbered = np.unique(corners[kept & whole[face]], return_inverse=True)
    starts = np.concatenate([[0], np.cumsum(sides[whole])])
    soup = FaceSoup(points[used], starts, renumbered.reshape(-1), np.flatnonzero(whole), used)
    return MergedSurface(
        soup, joined, np.flatnonzero(~named & (joined == np.arange(len(points)))), np.flatnonzero(~whole)
    )


def _require_numbers(surface: FileSurface, named: AnyArray) -> None:
    points, first = surface.points, surface.base or 0
    wrong = np.flatnonzero(named & ~(np.abs(points) <= LARGEST_COORDINATE).all(axis=1))  # and so not NaN
    if not len(wrong):
        return
    vertex = points[wrong[0]]
    at = ", ".join(f"{value:g}" for value in vertex)
    more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
    if np.isfinite(vertex).all():
        raise MeshError(
            f"vertex {wrong[0] + first}{more} is at ({at}), which is too large; "
            "coordinates are at most 1e12. Export the model again, in larger units."
        )
    raise MeshError(
        f"vertex {wrong[0] + first}{more} is at ({at}), which is not finite; "
        "coordinates must be numbers. Export the model again, or remove the vertex with its faces."
    )


def _first_alike(points: Points, named: AnyArray) -> AnyArray:
    """Return for each point (V,) the first one at the same position; those not `named` set no tolerance."""
    if not named.any():
        return np.arange(len(points))
    lowest = points[named].min(axis=0)
    span = float(np.linalg.norm(points[named].max(axis=0) - lowest)) or 1.0
    number = np.flatnonzero(np.isfinite(points).all(axis=1))
    steps = (points[number] - lowest) / max(_MERGE * span, np.finfo(float).smallest_subnormal)
    cells = np.round(np.clip(steps, -1e18, 1e18)).astype(np.int64)
    order = np.lexsort(cells.T)
    starts = np.append(True, (np.diff(cells[order], axis=0) != 0).any(axis=1))
    first = np.arange(len(points))
    first[number[order]] = number[order[starts]][np.cumsum(starts) - 1]
    return first
