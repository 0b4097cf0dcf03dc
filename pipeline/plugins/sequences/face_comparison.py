"""How the faces of two samples differ, and whether a sample faces inwards."""

from __future__ import annotations

import numpy as np

from flowsculpt.api.meshes import FileSurface, find_coincident


def have_same_faces(one: FileSurface, other: FileSurface) -> bool:
    return (
        len(one.points) == len(other.points)
        and np.array_equal(one.offsets, other.offsets)
        and np.array_equal(one.corners, other.corners)
    )


def difference_in_words(start: FileSurface, surface: FileSurface, first: str) -> str:
    """Return what differs between the faces of two samples, and what to do."""
    counts = [(len(each.points), len(each.offsets) - 1) for each in (start, surface)]
    if counts[0] != counts[1]:
        (v, f), (w, g) = counts
        fact = f"it has {w:,} vertices and {g:,} faces, and {first} has {v:,} and {f:,}"
    elif np.array_equal(np.sort(start.corners), np.sort(surface.corners)) and _is_flipped(start, surface):
        fact = f"its faces are wound the other way round than those of {first}"
    else:
        fact = f"its faces are not those of {first}"
    return f"{fact}. Export it as the others, or write faces: changing, where each frame shows its own."


def _is_flipped(start: FileSurface, surface: FileSurface) -> bool:
    if not np.array_equal(start.offsets, surface.offsets):
        return False
    a, b = (_directed(each) for each in (start, surface))
    return np.array_equal(
        np.sort(a[:, 0] * len(start.points) + a[:, 1]), np.sort(b[:, 1] * len(start.points) + b[:, 0])
    )


def _directed(surface: FileSurface) -> np.ndarray:
    """Return the directed sides (C, 2) of all faces."""
    following = np.arange(1, len(surface.corners) + 1)
    following[surface.offsets[1:] - 1] = surface.offsets[:-1]
    return np.column_stack([surface.corners, surface.corners[following]])


def faces_inwards(surface: FileSurface) -> bool:
    """Tell whether a surface is closed and consistent, and encloses a negative volume."""
    points, used = surface.points, np.zeros(len(surface.points), bool)
    used[surface.corners] = True
    if not np.isfinite(points[used]).all():
        return False
    sides = find_coincident(points, used)[_directed(surface)]
    there, back = (np.sort(a * len(points) + b) for a, b in (sides.T, sides.T[::-1]))
    if not np.array_equal(there, back):
        return False
    first = surface.corners[np.repeat(surface.offsets[:-1], np.diff(surface.offsets))]
    a, b, c = (points[rows] - points[used].mean(axis=0) for rows in (first, *_directed(surface).T))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) < 0.0
