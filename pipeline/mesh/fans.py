"""Fans: the faces around a vertex that are linked to each other; each fan gets a vertex of its own."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.face_soup import FaceSoup


def _fans(soup: FaceSoup, link: AnyArray) -> AnyArray:
    """Return a label for each corner (C,); corners of one fan of linked faces have the same."""
    onwards = link[soup.previous_side]  # the corner at the same vertex, in the face across
    ends = onwards < 0
    label = np.arange(len(link))
    jump = np.where(ends, label, onwards)
    for _ in range(int(np.bincount(soup.corners).max()).bit_length()):  # steps double until all are reached
        label, jump = np.minimum(label, label[jump]), jump[jump]
    return np.where(ends[jump], jump, label)


def detached_corners(soup: FaceSoup, link: AnyArray) -> AnyArray:
    """Return a label for each corner (C,), by which corners share vertices and all edges are sound.

    Faces that meet themselves again along an edge are cut off there.
    """
    whole = False
    while True:
        label = _fans(soup, link)
        wrong = _wrong_sides(label, label[soup.next_side])
        if not len(wrong):
            return label
        if whole:
            faces = np.zeros(len(soup), bool)
            faces[soup.owners[wrong]] = True
            wrong = np.flatnonzero(faces[soup.owners])
        link = link.copy()
        across = link[wrong]
        link[across[across >= 0]] = -1
        link[wrong] = -1
        whole = True


def _wrong_sides(tails: AnyArray, heads: AnyArray) -> AnyArray:
    """Return the sides (K,) at edges with more than two sides, or with two in the same direction."""
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    _, edge, counts = np.unique(low * len(tails) + high, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    along = np.bincount(edge, tails < heads)
    return np.flatnonzero(((counts > 2) | ((counts == 2) & (along != 1)))[edge])
