"""What stands before the lens, at one moment and while the shutter is open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.scene.camera import Camera
from render.scene.quality import PASS_SAMPLES
from render.scene.spheres import Spheres
from render.scene.stage import Placement
from render.scene.surface import Surface

MOST_STEP = 1.0
"""Pixels that a point of the subject may move from one sub-frame to the next."""

MOST_SUBFRAMES = 16

FEWEST_SAMPLES = 4
"""Of a sub-frame, where the picture has twice as many or more. Multijitter spreads the samples of a pass
evenly, which several lamps need: passes of one or two have three times the noise for the same total."""

EVEN = (1, 2, 3, 4, 6, 8, 9, 12, 15, 16)
"""Samples of a pass that Mitsuba's multijitter takes as they are; it rounds others up to a rectangle."""


@dataclass(frozen=True, eq=False)
class Moment:
    """A subject on its stage before a lens."""

    subject: Surface | Spheres
    placement: Placement
    camera: Camera

    def pixels(self, size: tuple[int, int], points: ArrayLike | None = None) -> NDArray[np.float64]:
        """(N, 3) of the subject's points, or others: pixels from the middle, right and up, and depth.

        size: width and height of the picture
        """
        if points is None:
            points = self.subject.centres if isinstance(self.subject, Spheres) else self.subject.vertices
        seen = self.camera.project(points, size[0] / size[1])
        return seen * (size[0] / 2.0, size[1] / 2.0, 1.0)

    def surface(self, width: int) -> Surface:
        """The subject as triangles, as fine as a picture `width` pixels wide shows it."""
        subject = self.subject
        return subject.surface(self.camera, width) if isinstance(subject, Spheres) else subject

    def dyed(self, attributes: dict[str, NDArray[np.float32]]) -> Moment:
        """The same with more attributes of the subject's points."""
        both = {**self.subject.attributes, **attributes}
        return replace(self, subject=replace(self.subject, attributes=both))


@dataclass(frozen=True, eq=False)
class Shutter:
    """While light comes in.

    opens, closes  frames from the moment of the picture; opens < closes
    at             what stands before the lens so many frames from there; always the same points
    """

    opens: float
    closes: float
    at: Callable[[float], Moment]

    def offsets(self, count: int) -> list[float]:
        """The middles of `count` equal parts of the time."""
        return [self.opens + (i + 0.5) / count * (self.closes - self.opens) for i in range(count)]

    def longest_way(self, size: tuple[int, int]) -> float:
        """Pixels that the fastest point moves in the picture, going on all the time as in its faster half."""
        opens, closes = self.opens, self.closes
        places = [self.at(offset).pixels(size) for offset in (opens, 0.5 * (opens + closes), closes)]
        reach = 0.55 * np.array(size)  # a little more than what is in the picture
        seen = [(np.abs(place[:, :2]) < reach).all(axis=1) & (place[:, 2] > 0.0) for place in places]
        steps = [np.linalg.norm(b[:, :2] - a[:, :2], axis=1) for a, b in pairwise(places)]
        there = seen[0] | seen[1] | seen[2]
        ahead = np.all([place[:, 2] > 0.0 for place in places], axis=0)
        return 2.0 * float(np.max(np.where(there & ahead, np.maximum(*steps), 0.0), initial=0.0))


def subframes(way: float, samples: int) -> int:
    """How many sub-frames a picture of so many samples a pixel takes, its fastest point moving `way` pixels.

    As few as keep it within MOST_STEP from one to the next, of those that give every sub-frame the same
    samples, in passes that are not tiny; the most of these where none are enough.
    """
    fewest = FEWEST_SAMPLES if samples >= 2 * FEWEST_SAMPLES else 1
    divisors = [n for n in range(1, min(MOST_SUBFRAMES, samples // fewest) + 1) if samples % n == 0]
    possible = [n for n in divisors if n == 1 or _even(samples // n) >= fewest]
    return next((n for n in possible if n * MOST_STEP >= way), possible[-1])


def passes_of(samples: int, subframes: int) -> list[int]:
    """The samples of each pass of a sub-frame: equal, and all of `samples` together if they can be.

    Samples that do not divide are rounded up.
    """
    each = -(-samples // subframes)
    if subframes == 1:
        size = min(each, PASS_SAMPLES)
        return [size] * (each // size)
    size = _even(each)
    return [size] * (each // size)


def turns_of(samples: int, subframes: int) -> list[int]:
    """The samples of each pass of a sub-frame whose passes take turns with those of the others: all passes of
    one turn have about PASS_SAMPLES together, so that a picture may end between turns."""
    size = passes_of(samples, subframes)[0]
    fewest = max(FEWEST_SAMPLES, -(-PASS_SAMPLES // subframes))
    size = min((n for n in EVEN if size % n == 0 and n >= fewest), default=size)
    return [size] * (-(-samples // subframes) // size)


def _even(samples: int) -> int:
    return max(n for n in EVEN if samples % n == 0)


def batch_of(passes: int, samples: int) -> int:
    """How many passes of so many samples make one of about PASS_SAMPLES, so that none is left over."""
    most = max(1, PASS_SAMPLES // samples)
    return max(n for n in range(1, most + 1) if passes % n == 0)
