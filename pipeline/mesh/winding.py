"""Winding: faces of one connected surface run the same way round, and those of a closed one face outwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.face_soup import FaceSoup, components


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
    part = components(len(soup), ends, others)
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
    agree = components(
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
    for seed in np.flatnonzero(components(len(faces), ends, others) == np.arange(len(faces))):
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
        turned[still] ^= ~_enclosed(soup, part, roots, still)
    inside_out = np.zeros(len(soup), bool)
    inside_out[roots[turned]] = True
    return inside_out[part], mended[part]


def _enclosed(soup: FaceSoup, part: AnyArray, roots: AnyArray, wanted: AnyArray) -> AnyArray:
    """Tell which of the `wanted` parts, numbers in `roots`, lie in the bounding box of another of `roots`."""
    points = soup.points[soup.corners]
    low, high = np.full((len(soup), 3), np.inf), np.full((len(soup), 3), -np.inf)
    np.minimum.at(low, part[soup.owners], points)
    np.maximum.at(high, part[soup.owners], points)
    low, high = low[roots], high[roots]
    inside = [(low < low[k]).all(axis=1) & (high > high[k]).all(axis=1) for k in wanted]
    return np.array([others.any() for others in inside])
