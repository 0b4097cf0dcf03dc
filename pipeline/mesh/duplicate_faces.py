"""Faces that are wrong by themselves: those that name a vertex twice, stand twice, or lie back to back."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.face_soup import FaceSoup, components


def cut_repeats(soup: FaceSoup) -> tuple[FaceSoup, AnyArray]:
    """Cut faces that name a vertex twice in two there, again and again; parts with two corners are dropped.

    Returns the soup with the parts at its end, and the vertex (K,) that each such face names twice.
    """
    order = np.lexsort([soup.corners, soup.owners])
    corners, owners = soup.corners[order], soup.owners[order]
    again = np.flatnonzero((np.diff(corners) == 0) & (np.diff(owners) == 0))
    faces, first = np.unique(owners[again], return_index=True)
    if not len(faces):
        return soup, faces
    parts = [
        (part, soup.faces[f])
        for f in faces.tolist()
        for part in _simple_parts(soup.corners[soup.offsets[f] : soup.offsets[f + 1]].tolist())
    ]
    whole = np.ones(len(soup), bool)
    whole[faces] = False
    rest = soup.keep_faces(whole)
    lengths = [len(part) for part, _ in parts]
    cut = replace(
        rest,
        offsets=np.concatenate([rest.offsets, rest.offsets[-1] + np.cumsum(lengths, dtype=np.int64)]),
        corners=np.concatenate([rest.corners, *(np.array(part, np.int64) for part, _ in parts)]),
        faces=np.concatenate([rest.faces, np.array([face for _, face in parts], np.int64)]),
    )
    return cut, corners[again[first]]


def _simple_parts(corners: list[int]) -> list[list[int]]:
    """Return the loops of a polygon, each without a vertex twice, that have three corners at least."""
    loops: list[list[int]] = []
    path: list[int] = []
    for corner in corners:
        if corner in path:
            at = path.index(corner)
            loops.append(path[at:])
            path = path[:at]
        path.append(corner)
    return [loop for loop in (*loops, path) if len(loop) >= 3]


class DuplicateFaces(NamedTuple):
    """Faces to drop, by the reason; each (F,) bool.

    twice    an earlier face has the same corners in the same order
    doubled  an earlier face is its back, and both are a sheet of their own
    inner    it and its back lie inside, between two solids that share this wall
    """

    twice: AnyArray
    doubled: AnyArray
    inner: AnyArray


def find_duplicates(soup: FaceSoup) -> DuplicateFaces:
    """Find faces that stand twice or back to back."""
    twice, mate = np.zeros(len(soup), bool), np.full(len(soup), -1)
    for sides in np.unique(soup.sides):
        faces = np.flatnonzero(soup.sides == sides)
        rows, turned = _from_lowest(soup.corners[soup.offsets[faces][:, None] + np.arange(sides)])
        order = np.lexsort([faces, turned, *rows.T[::-1]])
        rows, turned, faces = rows[order], turned[order], faces[order]
        equal = (np.diff(rows, axis=0) == 0).all(axis=1)
        twice[faces[1:][equal & (turned[1:] == turned[:-1])]] = True
        starts = np.flatnonzero(np.append(True, ~equal))
        turns = np.flatnonzero(equal & (turned[1:] != turned[:-1]))
        fronts, backs = faces[starts[np.searchsorted(starts, turns, side="right") - 1]], faces[turns + 1]
        mate[fronts], mate[backs] = backs, fronts
    doubled, inner = mate >= 0, np.zeros(len(soup), bool)
    if doubled.any():
        inner = _walls(soup, mate, ~twice)
        doubled &= ~inner & (mate < np.arange(len(soup)))
    return DuplicateFaces(twice, doubled, inner)


def _from_lowest(rows: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return polygons (N, n) from their lowest corner on, towards the lower neighbour; True where turned."""
    count = rows.shape[1]
    lowest, step = np.argmin(rows, axis=1)[:, None], np.arange(count)
    onwards = np.take_along_axis(rows, (lowest + step) % count, axis=1)
    backwards = np.take_along_axis(rows, (lowest - step) % count, axis=1)
    turned = onwards[:, 1] > backwards[:, 1]
    return np.where(turned[:, None], backwards, onwards), turned


def _walls(soup: FaceSoup, mate: AnyArray, counted: AnyArray) -> AnyArray:
    """Return which of the faces with a `mate` at their back lie between two solids.

    Such walls are regions of doubled faces whose rim is nowhere free: other faces go on at both sides of it.
    """
    doubled = mate >= 0
    sides = np.flatnonzero(counted[soup.owners])
    low, high = np.minimum(soup.corners, soup.heads), np.maximum(soup.corners, soup.heads)
    _, edge = np.unique((low * len(soup.points) + high)[sides], return_inverse=True)
    edge, owner = edge.reshape(-1), soup.owners[sides]
    inside = doubled[owner]
    of_doubled = np.bincount(edge, inside)
    others = np.bincount(edge, ~inside)
    rim, free = (of_doubled == 2) & (others >= 2), (of_doubled == 2) & (others < 2)
    some = np.empty(len(others), np.int64)
    some[edge[inside]] = owner[inside]  # one of the doubled faces at each edge
    pairs = np.flatnonzero(doubled)
    region = components(
        len(soup), np.append(owner[inside], pairs), np.append(some[edge[inside]], mate[pairs])
    )
    has_rim, has_free = np.zeros(len(soup), bool), np.zeros(len(soup), bool)
    has_rim[region[owner[inside & rim[edge]]]] = True
    has_free[region[owner[inside & free[edge]]]] = True
    return doubled & (has_rim & ~has_free)[region]
