"""Few Bézier keys through many samples of a value over time.

The method follows Schneider, *An algorithm for automatically fitting digitized curves* (Graphics Gems, 1990,
pp. 612-626): least squares for the control points, and another key where the worst sample is too far away.
The samples are values of a function of time, and handles are a third of their segment long. So the parameter
of every sample is known, which Schneider finds by iteration; a curve cannot turn back in time; and the best
values and slopes of all keys together are the solution of one linear system, with continuous slopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flowsculpt.api.meshes import Floats, Indices

SHARE = 0.8  # of the tolerance that a segment fitted alone may use: together with others it fits less well

LEAST_HALVED = 4  # places between two keys from which on a neighbour of a segment is halved for its sake

PINNED = 1e4  # weight of the first and the last sample over the others: keys there have their values

STIFFNESS = 1e-9
"""Weight of bending against samples: it decides slopes where samples alone do not."""


class FittedKey(NamedTuple):
    """A key with its slope, the same on both sides.

    time   of the key, in the unit of the samples
    value  (K,)
    slope  (K,), value per unit of time
    """

    time: float
    value: Floats
    slope: Floats


class FittedCurve(NamedTuple):
    """Keys of a curve, and the largest distance (K,) of a sample from it."""

    keys: list[FittedKey]
    error: Floats


def fit(
    times: Sequence[float] | Floats,
    values: Floats,
    tolerance: Floats | float,
    whole: bool = False,
) -> FittedCurve:
    """Fit keys to samples: few, and so that no sample is farther away than the tolerance.

    times      (N,) ascending, in frames; samples at one time count as a step, of which the last one stays
    values     (N, K)
    tolerance  of each of the K values, above 0
    whole      put keys on whole frames only; the error may then exceed the tolerance, since no key can
               stand between two frames

    The first key is at the first sample, the last at the last one, and they have their values; of whole
    frames, those around them.
    """
    at, rows = _distinct(np.asarray(times, np.float64), np.asarray(values, np.float64))
    scaled = rows / np.broadcast_to(np.asarray(tolerance, np.float64), rows.shape[1:])
    places = np.arange(np.floor(at[0]), np.ceil(at[-1]) + 1.0) if whole else at
    knots = _segments(at, scaled, places)
    while True:
        solved = _solve(places[knots], at, scaled)
        apart = np.abs(evaluate(places[knots], solved, at) - scaled).max(axis=1)
        added = _splits(places, knots, at, apart)
        if not len(added):
            break
        knots = np.union1d(knots, added)
    knots, solved = _pruned(places, knots, solved, at, scaled)
    for end in (0, -1):
        if places[knots[end]] == at[end]:
            solved[end, 0] = scaled[end]
    unit = np.broadcast_to(np.asarray(tolerance, np.float64), rows.shape[1:])
    keys = [
        FittedKey(float(time), row[0] * unit, row[1] * unit)
        for time, row in zip(places[knots], solved, strict=True)
    ]
    error = np.abs(evaluate(places[knots], solved, at) - scaled).max(axis=0) * unit
    return FittedCurve(keys, error)


def _distinct(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return samples at distinct times: of several at one time the last."""
    last = np.append(np.diff(times) > 0, True)
    return times[last], values[last]


def _segments(at: Floats, scaled: Floats, places: Floats) -> Indices:
    """Return the places of keys, as indices: each segment the longest whose samples one cubic fits.

    Lengths are doubled until a segment does not fit, then halved between the last two.
    """
    knots, last = [0], len(places) - 1
    while knots[-1] < last:
        start = knots[-1]
        good, reach = start + 1, 2
        bad = last + 1
        while good < last and bad > last:
            tried = min(last, start + reach)
            if _fits(at, scaled, places[start], places[tried]):
                good, reach = tried, 2 * reach
            else:
                bad = tried
        while bad <= last and bad - good > 1:
            middle = (good + bad) // 2
            if _fits(at, scaled, places[start], places[middle]):
                good = middle
            else:
                bad = middle
        knots.append(good)
    return np.array(knots)


def _fits(at: Floats, scaled: Floats, start: float, end: float) -> bool:
    """Tell whether one cubic is near all samples from `start` to `end`."""
    first, stop = np.searchsorted(at, start), np.searchsorted(at, end, side="right")
    if stop - first <= 4:
        return True
    share = (at[first:stop] - start) / (end - start)
    basis = np.stack([np.ones_like(share), share, share**2, share**3], axis=1)
    rows = scaled[first:stop]
    normal = basis.T @ basis + 1e-12 * np.eye(4)
    return bool(np.abs(basis @ np.linalg.solve(normal, basis.T @ rows) - rows).max() <= SHARE)


def _hermite(share: Floats, length: Floats) -> Floats:
    """Return the weights (N, 4) of start, its slope, end, and its slope, at shares of a segment."""
    rest = 1.0 - share
    return np.stack(
        [
            rest * rest * (1.0 + 2.0 * share),
            length * share * rest * rest,
            share * share * (3.0 - 2.0 * share),
            -length * share * share * rest,
        ],
        axis=1,
    )


def evaluate(knots: Floats, solved: Floats, at: Floats) -> Floats:
    """Return the values (T, K) of a spline with values and slopes (M, 2, K) at its knots (M,)."""
    segment = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, max(0, len(knots) - 2))
    if len(knots) == 1:
        return np.repeat(solved[0, :1], len(at), axis=0)
    length = knots[segment + 1] - knots[segment]
    weights = _hermite((at - knots[segment]) / length, length)
    ends = np.concatenate([solved[segment], solved[segment + 1]], axis=1)
    return np.asarray(np.einsum("nw,nwk->nk", weights, ends))


def _solve(knots: Floats, at: Floats, scaled: Floats) -> Floats:
    """Return values and slopes (M, 2, K) at knots (M,) that lie nearest to the samples, by least squares.

    The matrix is block tridiagonal with blocks of 2 × 2, and is eliminated block by block.
    """
    count = len(knots)
    if count == 1:
        return np.stack([scaled[-1:], np.zeros_like(scaled[-1:])], axis=1)
    segment = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, count - 2)
    lengths = np.diff(knots)
    weights = _hermite((at - knots[segment]) / lengths[segment], lengths[segment])
    blocks = np.zeros((count - 1, 4, 4))
    sides = np.zeros((count - 1, 4, scaled.shape[1]))
    counted = weights.copy()
    counted[[0, -1]] *= PINNED
    np.add.at(blocks, segment, counted[:, :, None] * weights[:, None, :])
    np.add.at(sides, segment, counted[:, :, None] * scaled[:, None, :])
    blocks += STIFFNESS * _bending(lengths)
    diagonal, right = np.zeros((count, 2, 2)), np.zeros((count, 2, scaled.shape[1]))
    diagonal[:-1] += blocks[:, :2, :2]
    diagonal[1:] += blocks[:, 2:, 2:]
    right[:-1] += sides[:, :2]
    right[1:] += sides[:, 2:]
    above = blocks[:, :2, 2:]
    for i in range(1, count):
        factor = np.linalg.solve(diagonal[i - 1].T, above[i - 1]).T
        diagonal[i] -= factor @ above[i - 1]
        right[i] -= factor @ right[i - 1]
    solved = np.empty_like(right)
    solved[-1] = np.linalg.solve(diagonal[-1], right[-1])
    for i in range(count - 2, -1, -1):
        solved[i] = np.linalg.solve(diagonal[i], right[i] - above[i] @ solved[i + 1])
    return solved


def _bending(lengths: Floats) -> Floats:
    """Return the quadratic forms (M, 4, 4) of ∫ y''² over segments of lengths (M,), times length³."""
    one = np.ones_like(lengths)
    rows = [
        [12 * one, 6 * lengths, -12 * one, 6 * lengths],
        [6 * lengths, 4 * lengths**2, -6 * lengths, 2 * lengths**2],
        [-12 * one, -6 * lengths, 12 * one, -6 * lengths],
        [6 * lengths, 2 * lengths**2, -6 * lengths, 4 * lengths**2],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _splits(places: Floats, knots: Indices, at: Floats, apart: Floats) -> Indices:
    """Return the places of further keys: in each segment whose worst sample is too far, at that sample.

    Where no place is left between its keys, its neighbours are halved, which frees the slopes of its keys.
    """
    count = max(1, len(knots) - 1)
    segment = np.clip(np.searchsorted(places[knots], at, side="right") - 1, 0, count - 1)
    found = set()
    for each in np.unique(segment[apart > 1.0]):
        there = np.flatnonzero(segment == each)
        worst = int(np.searchsorted(places, at[there[apart[there].argmax()]]))
        for near in (each, each - 1, each + 1):
            if not 0 <= near < len(knots) - 1:
                continue
            if knots[near + 1] - knots[near] < (2 if near == each else LEAST_HALVED):
                continue
            first, last = knots[near], knots[near + 1]
            found.add(min(max(worst, first + 1), last - 1) if near == each else (first + last) // 2)
            if near == each:
                break
    return np.array(sorted(found), np.int64)


def _pruned(
    places: Floats, knots: Indices, solved: Floats, at: Floats, scaled: Floats
) -> tuple[Indices, Floats]:
    """Remove keys that are not needed, one after another, and return the others with values and slopes.

    Two keys on either side of one that goes are moved for it; those beyond stay as they are.
    """
    i = 1
    while i < len(knots) - 1:
        low, high = max(0, i - 2), min(len(knots) - 1, i + 2)
        kept = np.r_[low:i, i + 1 : high + 1]
        moved = _moved(places[knots[kept]], solved[kept], at, scaled)
        if moved is None:
            i += 1
            continue
        solved[kept] = moved
        knots, solved = np.delete(knots, i), np.delete(solved, i, axis=0)
        i = max(1, i - 1)
    return knots, solved


def _moved(knots: Floats, solved: Floats, at: Floats, scaled: Floats) -> Floats | None:
    """Return values and slopes of some keys, of which the outermost stay, nearest to the samples between.

    None where a sample is too far away.
    """
    first, stop = np.searchsorted(at, knots[0]), np.searchsorted(at, knots[-1], side="right")
    there, rows = at[first:stop], scaled[first:stop]
    segment = np.clip(np.searchsorted(knots, there, side="right") - 1, 0, len(knots) - 2)
    lengths = np.diff(knots)[segment]
    weights = _hermite((there - knots[segment]) / lengths, lengths)
    matrix = np.zeros((len(there), 2 * len(knots)))
    for column in range(4):
        matrix[np.arange(len(there)), 2 * segment + column] = weights[:, column]
    inner, known = slice(2, -2), solved.reshape(2 * len(knots), -1).copy()
    fixed = matrix[:, :2] @ known[:2] + matrix[:, -2:] @ known[-2:]
    known[inner] = np.linalg.lstsq(matrix[:, inner], rows - fixed, rcond=None)[0]
    if len(rows) and np.abs(matrix @ known - rows).max() > 1.0:
        return None
    return known.reshape(len(knots), 2, -1)
