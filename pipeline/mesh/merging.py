"""Merging: coincident vertices of a file become one, and with them its loose triangles one surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.polygon_files import FileSurface
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import edge_keys
from pipeline.mesh.validation import twin_corners

_MERGE = 1e-9  # of the bounding box's diagonal: closer vertices are one


class MergedSurface(NamedTuple):
    """A file's polygons over merged vertices, not checked; `creases` (K, 2) are edges of the mesh."""

    mesh: PolygonMesh
    creases: AnyArray


def merge_coincident(loaded: FileSurface) -> MergedSurface:
    """Merge coincident vertices; drop unused ones and faces with fewer than three corners left."""
    points, offsets = loaded.points, loaded.offsets
    joined = _first_alike(points)
    corners, face = joined[loaded.corners], np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    following = np.arange(1, len(corners) + 1)
    some = offsets[1:] > offsets[:-1]
    following[offsets[1:][some] - 1] = offsets[:-1][some]
    kept = corners != corners[following]
    sides = np.bincount(face[kept], minlength=len(offsets) - 1)
    whole = sides >= 3
    used, renumbered = np.unique(corners[kept & whole[face]], return_inverse=True)
    mesh = PolygonMesh.from_arrays(
        points[used], np.cumsum([0, *sides[whole].tolist()]), renumbered.reshape(-1)
    )
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    inside = ((loaded.tagged >= 0) & (loaded.tagged < len(points))).all(axis=1)
    tagged = _existing(mesh, number[joined[loaded.tagged[inside]]])
    return MergedSurface(mesh, np.concatenate([_between_groups(mesh, loaded.groups[whole]), tagged]))


def _first_alike(points: AnyArray) -> AnyArray:
    """Return for each point (V,) the first one at the same position."""
    span = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    cells = np.round((points - points.min(axis=0)) / (_MERGE * span)).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return first[cell.reshape(-1)]


def _between_groups(mesh: PolygonMesh, groups: AnyArray) -> AnyArray:
    """Return the edges (K, 2) whose two faces belong to different groups."""
    twin, mine = twin_corners(mesh), groups[mesh.owners]
    parting = (twin >= 0) & (mine != mine[twin])
    return np.column_stack([mesh.corners[parting], mesh.heads[parting]])


def _existing(mesh: PolygonMesh, pairs: AnyArray) -> AnyArray:
    """Return the pairs (K, 2) that are edges; tags on others are ignored."""
    if not len(pairs):
        return pairs
    wanted = np.sort(pairs, axis=1)
    return wanted[(wanted[:, 0] >= 0) & np.isin(edge_keys(wanted), edge_keys(mesh.edges))]
