"""Automatic framing: the camera and the stage follow the sculpture, calmly.

For each frame the centre of the sculpture, the height of its lowest
point and the distance from which it just fits the safe area are found; the three tracks are smoothed so that
the camera never jumps, and so that nothing leaves the picture: the distance is smoothed from above, the
floor from below. A frame's camera depends on frames at most `3 * STEADINESS` away, so an edit late in
a shot leaves early pictures alone, and cameras can be found while frames still come.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.production.render_inputs.framing_geometry import (
    BoundingSpheres,
    axes_of,
    bearing,
    bounds,
    camera_of,
    fitting_distance,
    triple,
)
from render.scene.camera import Camera
from render.scene.stage import Stage, StagePlacement

if TYPE_CHECKING:
    from pipeline.shot.camera import View

STEADINESS = 10
"""Frames to either side over which the camera is smoothed; at 24 a second, about an eye's patience."""

FOOTING = 1
"""Frames to either side over which the floor is smoothed: few, so that the sculpture stands, not hovers."""

AHEAD = 3 * STEADINESS
"""Frames after one that its camera depends on: the distance is smoothed from above, around aims that are."""

STAGE_HALF_WIDTH = 1.5
"""Half the width of what the lens sees at its target, in stage units: a sculpture of half-size 1, and air."""


@dataclass(frozen=True)
class Framing:
    """One frame's camera, and where the stage stands for it."""

    camera: Camera
    placement: StagePlacement


def frame_all(
    views: Sequence[View],
    points_of: Callable[[int], AnyArray | BoundingSpheres],
    aspect: float,
    follow: float = 1.0,
) -> list[Framing]:
    """Frame a sequence: `points_of(i)` gives (N, 3) vertices, or balls, that `views[i]` sees.

    Points may be of any float type, and are reckoned with as float64.

    aspect  width to height
    follow  1 goes along with the sculpture; 0 holds the distance, the aim and the floor for the whole
            sequence, as a turntable wants them; in between, partly

    What a view says itself is taken as it is: a target, a distance, a position. The stage stands around the
    sculpture all the same, and is as large as it.
    """
    return Framer(views, points_of, aspect, follow).framings(len(views))


class Framer:
    """The cameras of a sequence while its frames come; arguments as of `frame_all`."""

    def __init__(
        self,
        views: Sequence[View],
        points_of: Callable[[int], AnyArray | BoundingSpheres],
        aspect: float,
        follow: float = 1.0,
    ) -> None:
        many = len(views)
        self._views, self._points_of, self._aspect, self._follow = views, points_of, aspect, follow
        self._half_widths = np.array([np.tan(view.field_of_view / 2) for view in views])
        self._centres, self._floors = np.zeros((many, 3)), np.zeros(many)
        self._middles, self._aims, self._sides = (np.zeros((many, 3, *more)) for more in ((), (), (3,)))
        self._reach, self._around = np.zeros(many), np.zeros(many)
        self._surveyed = self._aimed = self._given = 0

    def framings(self, come: int) -> list[Framing]:
        """Return the framings that the first `come` frames determine, without those returned before.

        If the camera does not follow the sculpture, there is none before all frames have come.
        """
        self._survey(come)
        whole = come == len(self._views)
        if not whole and self._follow != 1.0:
            return []
        self._aim(come if whole else come - STEADINESS)
        return self._place(come if whole else come - AHEAD)

    def _survey(self, come: int) -> None:
        for i in range(self._surveyed, come):
            self._centres[i], self._floors[i] = bounds(self._points_of(i), self._views[i])
        self._surveyed = come

    def _aim(self, last: int) -> None:
        """Find the look-at points up to frame `last`, and the least distances to them."""
        first = self._aimed
        last = self._aimed = max(first, last)
        moving = _part(self._centres[: self._surveyed], first, last, STEADINESS, _calmly)
        self._middles[first:last] = _between(self._centres.mean(axis=0), moving, self._follow)
        for i in range(first, last):
            view, middle, points = self._views[i], self._middles[i], self._points_of(i)
            aim = self._aims[i] = middle if view.target is None else np.array(view.target)
            side = self._sides[i] = axes_of(view, aim)
            self._reach[i] = self._around[i] = fitting_distance(points, aim, side, view, self._aspect)
            if view.target is not None:
                self._around[i] = fitting_distance(points, middle, side, view, self._aspect)

    def _place(self, last: int) -> list[Framing]:
        first = self._given
        last = self._given = max(first, last)
        floors, half_widths = self._floors[: self._surveyed], self._half_widths
        reach, around = self._reach[: self._aimed], self._around[: self._aimed]
        ground = _between(floors.min(), _part(floors, first, last, 2 * FOOTING, _standing), self._follow)
        away = _part(reach, first, last, 2 * STEADINESS, _beyond)
        wide = _part(around, first, last, 2 * STEADINESS, _beyond) * half_widths[first:last]
        distances = _between(reach.max(initial=0.0), away, self._follow)
        most = (around * half_widths[: self._aimed]).max(initial=0.0)
        sizes = _between(most, wide, self._follow) / STAGE_HALF_WIDTH
        return [
            self._framing(i, ground[i - first], distances[i - first], float(sizes[i - first]))
            for i in range(first, last)
        ]

    def _framing(self, i: int, ground: float, distance: float, size: float) -> Framing:
        view, (x, _, z) = self._views[i], self._middles[i]
        turn = view.azimuth if view.position is None else bearing(self._views[0], self._aims[0])[0]
        placement = StagePlacement(origin=triple([x, ground, z]), size=size, turn=turn)
        return Framing(camera_of(view, self._aims[i], self._sides[i], distance, size), placement)


def with_stage_in_view(framing: Framing, stage: Stage) -> Framing:
    """Move the camera until the reference objects of the stage are in the picture too."""
    return replace(framing, camera=stage.adjusted_camera(framing.camera, framing.placement))


def rotate_y(points: AnyArray, angle: float, about_origin: bool = False) -> AnyArray:
    """Turn (N, 3) points about the vertical axis of their bounds, or directions about y."""
    if angle == 0.0:
        return points
    low, high = points.min(axis=0), points.max(axis=0)
    pivot = np.zeros(3) if about_origin else (low + high) / 2
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray((points - pivot) @ turn.T + pivot)


def envelope(track: Floats, radius: int, extreme: Callable[[Floats], float]) -> Floats:
    """Return the extreme of each value's neighbours up to `radius` frames away."""
    return np.array([extreme(track[max(0, i - radius) : i + radius + 1]) for i in range(len(track))])


def smooth(track: Floats, radius: int) -> Floats:
    """Return the mean over `radius` frames to either side, weighted by a Hann window; fewer at the ends."""
    window = np.cos(np.linspace(-np.pi / 2, np.pi / 2, 2 * radius + 3)[1:-1]) ** 2
    smoothed = np.empty_like(track)
    for i in range(len(track)):
        first, last = max(0, i - radius), min(len(track), i + radius + 1)
        weights = window[first - i + radius : last - i + radius]
        smoothed[i] = weights @ track[first:last] / weights.sum()
    return smoothed


def _part(track: Floats, first: int, last: int, around: int, made: Callable[[Floats], Floats]) -> Floats:
    """Return `made(track)[first:last]`, computed from the frames that this part depends on."""
    begin = max(0, first - around)
    return made(track[begin:])[first - begin : last - begin]


def _calmly(track: Floats) -> Floats:
    return smooth(track, STEADINESS)


def _beyond(track: Floats) -> Floats:
    """Return a smooth track that is nowhere below another."""
    return smooth(envelope(track, STEADINESS, np.max), STEADINESS)


def _standing(track: Floats) -> Floats:
    """Return a smooth track that is nowhere above another."""
    return smooth(envelope(track, FOOTING, np.min), FOOTING)


def _between(held: Floats | float, moving: Floats, follow: float) -> Floats:
    """Interpolate from one value for all frames (`follow` 0) to a moving track (`follow` 1)."""
    if follow == 1.0:
        return moving
    return np.asarray(held + follow * (moving - held))
