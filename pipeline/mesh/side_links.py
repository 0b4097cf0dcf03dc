"""Side links: which sides of faces continue each other where more than two faces meet at an edge.

A surface has one or two faces at an edge. Where there are more, pairs of sides are chosen that stay joined,
and the other faces are separated there (cutting and stitching: Guéziec et al. 1998). Faces around a vertex
that are linked to each other are a fan; each fan gets a vertex of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.face_soup import FaceSoup, components

_MOST_PAIRED = 32
"""Faces at one edge: where there are more, all are separated, for their pairs would be too many."""

_SAME_DIRECTION = 1e-6
"""Radians: faces around an edge at a smaller angle to each other point the same way."""


class SideLinks(NamedTuple):
    """link (C,): the side across each edge, -1 where there is none; crowded (C,): over two faces are there"""

    link: AnyArray
    crowded: AnyArray


def link_sides(soup: FaceSoup) -> SideLinks:
    """Link sides that run between the same two vertices; where there are more than two, the best pairs."""
    low, high = np.minimum(soup.corners, soup.heads), np.maximum(soup.corners, soup.heads)
    keys = low * len(soup.points) + high
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.append(True, np.diff(keys[order]) != 0))
    counts = np.diff(np.append(starts, len(order)))
    link = np.full(len(keys), -1)
    first = starts[counts == 2]
    link[order[first]], link[order[first + 1]] = order[first + 1], order[first]
    crowded = np.zeros(len(keys), bool)
    crowded[order[np.repeat(counts > 2, counts)]] = True
    few = (counts > 2) & (counts <= _MOST_PAIRED)
    if few.any():
        edge = np.repeat(np.arange(len(counts)), counts)
        wanted = few[edge]
        _pair(soup, link, order[wanted], edge[wanted])
    return SideLinks(link, crowded)


def _pair(soup: FaceSoup, link: AnyArray, sides: AnyArray, edges: AnyArray) -> None:
    """Link the best pairs among `sides` (N,), which lie at crowded `edges` (N,) in ascending order."""
    linked = np.flatnonzero(link >= 0)
    part = components(len(soup), soup.owners[linked], soup.owners[link[linked]])[soup.owners[sides]]
    along = soup.corners[sides] < soup.heads[sides]
    inwards, angle = _directions(soup, sides, edges, along)
    around = np.lexsort([~along, np.floor(angle / _SAME_DIRECTION).astype(np.int64), edges])
    a, b, adjacent = _pairs(edges[around])
    a, b = around[a], around[b]
    # a solid lies between a side that runs down the edge and the next around it that runs up
    follows = np.where(adjacent == 1, ~along[a] & along[b], along[a] & ~along[b])
    cosine = np.einsum("ij,ij->i", inwards[a], inwards[b])
    rank = _rank(edges, part, a, b, (adjacent != 0) & follows, along, cosine)
    _take_best(link, sides, edges, a, b, rank)


def _directions(
    soup: FaceSoup, sides: AnyArray, edges: AnyArray, along: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Return unit vectors (N, 3) from the edge into the faces, and their angles (N,) about the edge.

    Angles count from the first face of each edge, counter-clockwise seen from the edge's higher vertex.
    """
    normals = soup.area_vectors[soup.owners[sides]]
    axis = soup.points[soup.heads[sides]] - soup.points[soup.corners[sides]]
    inwards = _unit(np.cross(_unit(normals), _unit(axis)))
    up = _unit(np.where(along[:, None], axis, -axis))
    first = np.searchsorted(edges, edges)
    reference = inwards[first]
    cosine = np.einsum("ij,ij->i", inwards, reference)
    sine = np.einsum("ij,ij->i", np.cross(reference, inwards), up)
    return inwards, np.mod(np.arctan2(sine, cosine) + 0.5 * _SAME_DIRECTION, 2.0 * np.pi)


def _unit(vectors: AnyArray) -> AnyArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _pairs(edges: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return all pairs of places at one edge, the lower first, and if they are neighbours around it.

    Neighbours are 1 where the second follows the first, -1 where the first follows the last, else 0.
    """
    starts = np.flatnonzero(np.append(True, np.diff(edges) != 0))
    counts = np.diff(np.append(starts, len(edges)))
    a_parts, b_parts, near = [], [], []
    for count in np.unique(counts):
        i, j = np.triu_indices(count, 1)
        at = starts[counts == count][:, None]
        a_parts.append((at + i).reshape(-1))
        b_parts.append((at + j).reshape(-1))
        adjacent = np.where(j - i == 1, 1, np.where(j - i == count - 1, -1, 0))
        near.append(np.broadcast_to(adjacent, (len(at), len(i))).reshape(-1))
    return np.concatenate(a_parts), np.concatenate(b_parts), np.concatenate(near)


def _rank(
    edges: AnyArray,
    part: AnyArray,
    a: AnyArray,
    b: AnyArray,
    encloses: AnyArray,
    along: AnyArray,
    cosine: AnyArray,
) -> AnyArray:
    """Return how well the pairs a, b continue each other; higher is better.

    First come the only two sides of one connected part, then sides of one part with the solid between them.
    Different parts are joined where, over all their common edges, they enclose a solid or lie flat.
    """
    same, opposite = part[a] == part[b], along[a] != along[b]
    count = int(part.max()) + 1
    _, inverse, often = np.unique(edges * count + part, return_inverse=True, return_counts=True)
    alone = same & (often[inverse.reshape(-1)][a] == 2)
    pair = np.minimum(part[a], part[b]) * count + np.maximum(part[a], part[b])
    _, of_pair = np.unique(pair, return_inverse=True)
    fit = 2.0 * encloses + opposite - cosine  # 0 to 4
    mean = np.bincount(of_pair.reshape(-1), fit + 1.0) / np.bincount(of_pair.reshape(-1))
    rank: AnyArray = mean[of_pair.reshape(-1)]
    rank[same] = fit[same]
    rank[same & encloses] += 10.0
    rank[alone] += 20.0
    return rank


def _take_best(
    link: AnyArray, sides: AnyArray, edges: AnyArray, a: AnyArray, b: AnyArray, rank: AnyArray
) -> None:
    """Link pairs by descending rank until no two free sides are left at an edge."""
    order = np.lexsort([-rank, edges[a]])
    a, b = a[order], b[order]
    while len(a):
        best = np.append(True, np.diff(edges[a]) != 0)
        one, other = sides[a[best]], sides[b[best]]
        link[one], link[other] = other, one
        free = (link[sides[a]] < 0) & (link[sides[b]] < 0)
        a, b = a[free], b[free]


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


def _fans(soup: FaceSoup, link: AnyArray) -> AnyArray:
    """Return a label for each corner (C,); corners of one fan of linked faces have the same."""
    onwards = link[soup.previous_side]  # the corner at the same vertex, in the face across
    ends = onwards < 0
    label = np.arange(len(link))
    jump = np.where(ends, label, onwards)
    for _ in range(int(np.bincount(soup.corners).max()).bit_length()):  # steps double until all are reached
        label, jump = np.minimum(label, label[jump]), jump[jump]
    return np.where(ends[jump], jump, label)


def _wrong_sides(tails: AnyArray, heads: AnyArray) -> AnyArray:
    """Return the sides (K,) at edges with more than two sides, or with two in the same direction."""
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    _, edge, counts = np.unique(low * len(tails) + high, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    along = np.bincount(edge, tails < heads)
    return np.flatnonzero(((counts > 2) | ((counts == 2) & (along != 1)))[edge])
