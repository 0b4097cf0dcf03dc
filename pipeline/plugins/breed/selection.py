"""Selection: candidates that show nothing are left out, and of the others those that differ most are chosen.

Two candidates are as far apart as their silhouettes, their colours and the course of their movement differ.
Chosen is, again and again, the candidate farthest from all that are chosen already (Gonzalez 1985), where the
distance of a weak picture counts less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flowsculpt.api.materials import linear_of_srgb
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.breed.colour_harmony import lab
from flowsculpt.pipeline.plugins.breed.trials import SHOWN, Trial

EXPLODES, LEAVES, STILL, FAINT, ALIKE = (
    "explodes",
    "leaves the picture",
    "hardly moves",
    "hardly shows",
    "looks like another",
)
"""Why a candidate is left out."""

LEAST_INSIDE = 0.97
"""Share of the vertices that must be in every picture."""

LEAST_CHANGE, LEAST_SHARE = 0.12, 0.3
"""Change of form, over the size at rest and over the parent's, below which a candidate hardly moves."""

LEAST_SEEN = 0.025
"""Difference of the first picture and another, in OKLab, below which a candidate hardly moves: a rod that is
twisted about its own axis does, and shows nothing of it."""

LEAST_OUTLINE, OF_COLOURS = 0.07, 4.0
"""Share of the silhouettes that must change, or pictures change so many times LEAST_SEEN: the camera alone
changes the shades of a drum that is twisted about its own axis."""

USUAL_GROWTH = 1.5
"""Growth of the vertices: a candidate with more than twice this, and more than twice that of its parents, is
crumpled, and counts less."""

LEAST_COVERED, MOST_COVERED = 0.035, 0.62
"""Share of the picture that a subject covers between which it is well seen."""

LEAST_CONTRAST = 0.045
"""Distance in OKLab between a subject and its surroundings below which it hardly shows."""

KEY_PICTURES = tuple(round(SHOWN * share) - 1 for share in (1 / 3, 2 / 3, 1))
"""Indices of the pictures that sheets show."""

SHAPE, COLOUR, MOVEMENT = 1.0, 1.6, 0.25
"""Weights of the parts of a distance."""

LEAST_APART = 0.12
"""Distance below which a candidate looks like another."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate as selection sees it.

    features  (K,) in which distances are measured
    quality   0 to 1: how well it is seen
    fault     why it is left out; empty where it is not
    """

    features: Floats
    quality: float
    fault: str


def judged(trial: Trial, parents: Sequence[Trial]) -> Candidate:
    """Judge a trial by what its parents do."""
    parent_change = max(float(parent.change.max()) for parent in parents)
    usual_growth = max(USUAL_GROWTH, *(parent.growth for parent in parents))
    contrast, light = _contrast(trial)
    change, covered = float(trial.change.max()), trial.covered[SHOWN // 2 :]
    seen_change = _seen_change(trial)
    least_seen = LEAST_SEEN * (1.0 if _outline_change(trial) >= LEAST_OUTLINE else OF_COLOURS)
    fault = ""
    if trial.inside < LEAST_INSIDE:
        fault = LEAVES
    elif seen_change < least_seen or change < max(LEAST_CHANGE, LEAST_SHARE * min(1.0, parent_change)):
        fault = STILL
    elif covered.min() < LEAST_COVERED or contrast < LEAST_CONTRAST or not 0.06 < light < 0.94:
        fault = FAINT
    seen = min(1.0, float(covered.min()) / 0.12) * (1.0 if covered.max() < MOST_COVERED else 0.6)
    moves = min(1.0, change / 0.35, seen_change / 0.06) * min(1.0, 2.5 / max(1e-6, change)) ** 0.5
    stands_out = min(1.0, contrast / 0.18)
    is_calm = min(1.0, 2.0 * usual_growth / trial.growth)
    return Candidate(_features(trial), float((seen * moves * stands_out * is_calm) ** 0.5), fault)


def chosen(candidates: Mapping[int, Candidate], parent: Floats, most: int) -> tuple[list[int], list[int]]:
    """Return the numbers of at most so many candidates that differ most, and of those that look like them.

    The chosen are in the order in which they were chosen; those with a fault are in neither list.

    parent  features of the parent: the first to be chosen differs from it
    """
    good = [number for number in sorted(candidates) if not candidates[number].fault]
    found: list[int] = []
    nearest = {number: _distance(candidates[number].features, parent) for number in good}
    while len(found) < most and (apart := [n for n in good if nearest[n] >= LEAST_APART]):
        best = max(apart, key=lambda n: (nearest[n] * candidates[n].quality, -n))
        found.append(best)
        good.remove(best)
        for number in good:
            distance = _distance(candidates[number].features, candidates[best].features)
            nearest[number] = min(nearest[number], distance)
    return found, [number for number in good if nearest[number] < LEAST_APART]


def _distance(one: Floats, other: Floats) -> float:
    return float(np.linalg.norm(one - other))


def _features(trial: Trial) -> Floats:
    """Return silhouettes, colours and the course of movement, each with its weight and for its own length."""
    shapes = trial.shapes[list(KEY_PICTURES)].astype(np.float64)
    padded = np.pad(shapes, ((0, 0), (1, 1), (1, 1)))
    rows, columns = shapes.shape[1:]
    windows = [padded[:, i : i + rows, k : k + columns] for i in range(3) for k in range(3)]
    soft = np.mean(windows, axis=0)
    colours = lab(_reduce(trial, list(KEY_PICTURES)))
    movement = np.concatenate([np.log1p(trial.change), 2.0 * trial.covered, [np.log(trial.growth)]])
    parts = ((SHAPE, soft), (COLOUR, colours), (MOVEMENT, movement))
    return np.concatenate([weight * part.ravel() / np.sqrt(part.size) for weight, part in parts])


def _reduce(trial: Trial, pictures: Sequence[int]) -> Floats:
    """Return pictures as linear light in 16 × 9 blocks."""
    values = linear_of_srgb(trial.pictures[list(pictures)].astype(np.float64) / 255.0)
    rows, columns = (
        np.linspace(0, side, n + 1).astype(int)[:-1]
        for side, n in zip(values.shape[1:3], (9, 16), strict=True)
    )
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=1), columns, axis=2)
    counts = np.outer(np.diff([*rows, values.shape[1]]), np.diff([*columns, values.shape[2]]))
    return np.asarray(sums / counts[None, :, :, None])


def _seen_change(trial: Trial) -> float:
    """Return how far the first picture and the one that differs most are apart, root mean square in OKLab."""
    colours = lab(_reduce(trial, range(SHOWN)))
    return float(np.sqrt(((colours - colours[0]) ** 2).sum(axis=-1).mean(axis=(1, 2)).max()))


def _outline_change(trial: Trial) -> float:
    """Return the share of the first silhouette and another that only one of them has, at most."""
    first, *others = trial.shapes > 0
    return max(float((first ^ other).sum() / max(1, (first | other).sum())) for other in others)


def _contrast(trial: Trial) -> tuple[float, float]:
    """Return how far the last picture's subject is from its surroundings in OKLab, and the mean lightness."""
    picture = trial.pictures[-1]
    shape = trial.shapes[-1] > 0
    rows, columns = shape.shape
    height, width = picture.shape[:2]
    y, x = (np.arange(rows) * height) // rows, (np.arange(columns) * width) // columns
    blocks = np.add.reduceat(np.add.reduceat(picture.astype(np.float64), y, axis=0), x, axis=1)
    counts = np.outer(np.diff([*y, height]), np.diff([*x, width]))[:, :, None]
    colours = lab(linear_of_srgb(blocks / counts / 255.0))
    padded = np.pad(shape, 2)
    near = (
        np.any([padded[i : i + rows, k : k + columns] for i in range(5) for k in range(5)], axis=0) & ~shape
    )
    if not shape.any() or not near.any():
        return 0.0, float(colours[..., 0].mean())
    subject, around = colours[shape], colours[near].mean(axis=0)
    return float(np.linalg.norm(subject - around, axis=1).mean()), float(colours[..., 0].mean())
