"""Sharing the tidying of a large surface out to threads."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.mesh._kernels_halfedge import Surface
from pipeline.mesh.halfedge import WORTH_SHARING
from pipeline.resample._kernels_lists import Changes
from pipeline.resample._kernels_parts import PARTS, Shares, deal, deal_faces, gather, tidy_parts

_SAMPLED = 512  # of so many listed faces one tells where the work is
_LEAST = 1 << 14  # listed faces and edges, below which one thread has soon done them


def worth_parts(faces: int, changes: Changes) -> bool:
    """Whether a surface is so large, and so much of it listed, that sharing it out pays."""
    return 3 * faces > WORTH_SHARING and int(changes.fresh[0]) + int(changes.shorts[0]) > _LEAST


def tidied_in_parts(
    surface: Surface, limits: Floats, changes: Changes, dead: tuple[Indices, Indices], obtuse: Indices
) -> tuple[int, int]:
    """Collapse and flip what lies well within parts of space; answers how many collapses and flips.

    What is left is listed in `changes`, as it is for `tidy`, which has to come next.
    """
    axis, planes = _planes(surface, changes)
    shares = _shares(len(changes.marks), len(changes.shorts), int(obtuse[0]))
    deal_faces(surface, planes, axis, changes, shares.fresh)
    deal(surface, planes, axis, changes.shorts, shares.shorts)
    deal(surface, planes, axis, obtuse, shares.obtuse)
    counts = np.zeros((PARTS, 2), np.int64)
    tidy_parts(surface, limits, planes, axis, changes, shares, counts)
    gather(surface, changes, dead, shares)
    collapses, flips = counts.sum(axis=0)
    return int(collapses), int(flips)


def _planes(surface: Surface, changes: Changes) -> tuple[int, Floats]:
    """The axis along which the work reaches farthest, and where to cut it into equal parts."""
    fresh, shorts = (items[1 : 1 + items[0] : _SAMPLED] for items in (changes.fresh, changes.shorts))
    vertices = surface.vert[np.concatenate([3 * fresh, shorts])]
    places = surface.points[vertices[vertices >= 0]]
    axis = int(np.argmax(np.ptp(places, axis=0)))
    between = np.quantile(places[:, axis], np.arange(1, PARTS) / PARTS)
    return axis, np.array([-np.inf, *between, np.inf])


def _shares(faces: int, halfedges: int, obtuse: int) -> Shares:
    """Empty lists. Most of their memory is never touched."""
    rooms = (faces, faces, halfedges, faces, faces, obtuse, faces)
    shares = Shares(*(np.empty((PARTS, room + 1), np.int32) for room in rooms))
    for rows in shares:
        rows[:, 0] = 0
    return shares
