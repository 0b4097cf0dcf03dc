"""Side links: which sides of faces continue each other where more than two faces meet at an edge.

A surface has one or two faces at an edge. Where there are more, pairs of sides are chosen that stay joined,
and the other faces are separated there (cutting and stitching: Guéziec et al. 1998). Faces around a vertex
that are linked to each other are a fan; each fan gets a vertex of its own.

Faces of one connected surface run the same way round, and those of a closed one face outwards.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh.face_soup import FaceSoup, connected_components
from flowsculpt.pipeline.mesh.normals import unit

_MOST_PAIRED = 32
"""Faces at one edge: where there are more, all are separated, for their pairs would be too many."""

_SAME_DIRECTION = 1e-6  # radians: faces around an edge at a smaller angle to each other point the same way


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
    part = connected_components(len(soup), soup.owners[linked], soup.owners[link[linked]])[soup.owners[sides]]
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
    inwards = unit(np.cross(unit(normals), unit(axis)))
    up = unit(np.where(along[:, None], axis, -axis))
    first = np.searchsorted(edges, edges)
    reference = inwards[first]
    cosine = np.einsum("ij,ij->i", inwards, reference)
    sine = np.einsum("ij,ij->i", np.cross(reference, inwards), up)
    return inwards, np.mod(np.arctan2(sine, cosine) + 0.5 * _SAME_DIRECTION, 2.0 * np.pi)


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


class Winding(NamedTuple):
    """The faces to reverse, and the links to cut, so that all linked sides run in opposite directions.

    against  (F,) True for faces wound against their neighbours
    inwards  (F,) True for faces of consistent, closed parts that are inside out
    cut      (C,) True for sides whose link contradicts: the surface is one-sided
    """

    against: AnyArray
    inwards: AnyArray
    cut: AnyArray

    @property
    def reversed_faces(self) -> AnyArray:
        """(F,) True for faces to reverse."""
        return self.against ^ self.inwards


def find_winding(soup: FaceSoup, link: AnyArray) -> Winding:
    """Return the winding of a soup with the links (C,) of its sides.

    Of each connected part, the smaller area is reversed. A part that is closed and had to be made consistent
    faces outwards; one that was consistent is reversed only if it is inside out, see `_inside_out`.
    """
    side = np.flatnonzero(link > np.arange(len(link)))
    across = link[side]
    ends, others = soup.owners[side], soup.owners[across]
    alike = soup.corners[side] == soup.corners[across]
    part = connected_components(len(soup), ends, others)
    against = np.zeros(len(soup), bool)
    cut = np.zeros(len(link), bool)
    if alike.any():
        against, one_sided = _parities(len(soup), ends, others, alike)
        if one_sided.any():
            spread = _spread(one_sided, ends, others, alike)
            contradicted = np.bincount(part[ends], alike ^ spread[ends] ^ spread[others], len(soup))
            fewer = contradicted < np.bincount(part[ends], alike, len(soup))  # than as the file has them
            against |= spread & fewer[part]
        wrong = alike ^ against[ends] ^ against[others]
        cut[side[wrong]] = cut[across[wrong]] = True
        larger = np.bincount(part, np.where(against, soup.areas, -soup.areas), len(soup)) > 0
        against ^= larger[part]
    is_open = np.zeros(len(soup), bool)
    is_open[part[soup.owners[(link < 0) | cut]]] = True
    inwards, mended = _inside_out(soup, part, ~is_open[part], against)
    return Winding(against ^ (inwards & mended), inwards & ~mended, cut)


def _parities(count: int, ends: AnyArray, others: AnyArray, alike: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return which faces to reverse, and which belong to parts where no choice is consistent.

    Each face is two nodes, 2f as it is and 2f + 1 reversed; links join those that agree.
    """
    turn = alike.astype(np.int64)
    agree = connected_components(
        2 * count,
        np.concatenate([2 * ends, 2 * ends + 1]),
        np.concatenate([2 * others + turn, 2 * others + 1 - turn]),
    )
    same, turned = agree[::2], agree[1::2]
    return same > turned, same == turned


def _spread(faces: AnyArray, ends: AnyArray, others: AnyArray, alike: AnyArray) -> AnyArray:
    """Return which of `faces` (F,) to reverse so that the links of a spanning forest agree."""
    starts, links = np.concatenate([ends, others]), np.concatenate([others, ends])
    order = np.argsort(starts, kind="stable")
    starts, links, turn = starts[order], links[order], np.concatenate([alike, alike])[order]
    first = np.searchsorted(starts, np.arange(len(faces) + 1))
    visited, turned = ~faces, np.zeros(len(faces), bool)
    for seed in np.flatnonzero(connected_components(len(faces), ends, others) == np.arange(len(faces))):
        front = np.array([seed])[~visited[seed : seed + 1]]
        visited[front] = True
        while len(front):
            counts = first[front + 1] - first[front]
            row = np.repeat(first[front] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
            new, index = np.unique(links[row], return_index=True)
            new, row = new[~visited[new]], row[index[~visited[new]]]
            turned[new] = turned[starts[row]] ^ turn[row]
            visited[new] = True
            front = new
    return turned


def _inside_out(
    soup: FaceSoup, part: AnyArray, closed: AnyArray, against: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Return the faces (F,) of closed parts that face inwards, once those in `against` are reversed.

    Also returns which faces are of parts that have some in `against`.

    A part that was consistent in the file may be the wall of a cavity, which rightly faces inwards. If all of
    them together enclose a negative volume, the model is mirrored and all are reversed. Of the others, a part
    of negative volume is reversed unless its bounding box lies in that of another closed part.
    """
    mended = np.zeros(len(soup), bool)
    mended[part[against]] = True
    if not closed.any():
        return closed, mended[part]
    volume = np.bincount(part, np.where(against, -soup.volumes, soup.volumes), len(soup))
    roots = np.flatnonzero(closed & (part == np.arange(len(part))))
    size, consistent = volume[roots], ~mended[roots]
    turned = ~consistent & (size < 0)
    if consistent.any() and size[consistent].sum() < 0:
        turned |= consistent
    still = np.flatnonzero(consistent & (np.where(turned, -size, size) < 0))
    if len(still):
        turned[still] ^= ~_find_enclosed(soup, part, roots, still)
    inside_out = np.zeros(len(soup), bool)
    inside_out[roots[turned]] = True
    return inside_out[part], mended[part]


def _find_enclosed(soup: FaceSoup, part: AnyArray, roots: AnyArray, wanted: AnyArray) -> AnyArray:
    """Tell which of the `wanted` parts, numbers in `roots`, lie in the bounding box of another of `roots`."""
    points = soup.points[soup.corners]
    low, high = np.full((len(soup), 3), np.inf), np.full((len(soup), 3), -np.inf)
    np.minimum.at(low, part[soup.owners], points)
    np.maximum.at(high, part[soup.owners], points)
    low, high = low[roots], high[roots]
    inside = [(low < low[k]).all(axis=1) & (high > high[k]).all(axis=1) for k in wanted]
    return np.array([others.any() for others in inside])
