"""Automatic framing: the camera and the stage follow the sculpture, calmly.

The whole range is looked at first. For each frame the centre of the sculpture, the height of its lowest
point and the distance from which it just fits the safe area are found; the three tracks are smoothed so that
the camera never jumps, and so that nothing leaves the picture: the distance is smoothed from above, the
floor from below. A frame's camera depends on frames at most `3 * STEADINESS` away, so an edit late in
a shot leaves early pictures alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from render.camera import Camera
from render.plain import from_plain, to_plain
from render.stage import Placement, Stage

STEADINESS = 10
"""Frames to either side over which the camera is smoothed; at 24 a second, about an eye's patience."""

FOOTING = 1
"""Frames to either side over which the floor is smoothed: few, so that the sculpture stands, not hovers."""

STAGE_HALF_WIDTH = 1.5
"""Half the width of what the lens sees at its target, in stage units: a sculpture of half-size 1, and air."""


class Balls(NamedTuple):
    """Points (N, 3) with something around them: radii (N,), scene units."""

    points: Points
    radii: Floats


@dataclass(frozen=True)
class View:
    """From where a frame is seen. Angles in radians; azimuth 0 looks from +z, a quarter turn from +x.

    margin is the part of the picture's width or height kept free at every side.
    """

    azimuth: float
    elevation: float
    field_of_view: float
    margin: float

    @property
    def axes(self) -> Floats:
        """(3, 3): rows right, up and back, the camera's axes."""
        sin_a, cos_a = np.sin(self.azimuth), np.cos(self.azimuth)
        sin_e, cos_e = np.sin(self.elevation), np.cos(self.elevation)
        return np.array(
            [
                [cos_a, 0.0, -sin_a],
                [-sin_e * sin_a, cos_e, -sin_e * cos_a],
                [cos_e * sin_a, sin_e, cos_e * cos_a],
            ]
        )


@dataclass(frozen=True)
class Framing:
    """One frame's camera, and where the stage stands for it."""

    camera: Camera
    placement: Placement

    def as_data(self) -> dict[str, Any]:
        return {"camera": to_plain(self.camera), "placement": to_plain(self.placement)}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Framing:
        return cls(from_plain(Camera, data["camera"]), from_plain(Placement, data["placement"]))


def frame_all(
    views: Sequence[View], points_of: Callable[[int], Points | Balls], aspect: float, still: bool = False
) -> list[Framing]:
    """Frame a sequence: `points_of(i)` gives (N, 3) vertices, or balls, that `views[i]` sees.

    aspect  width to height

    `still` holds the distance, the aim and the floor for the whole sequence, as a turntable wants them.
    """
    centres = np.empty((len(views), 3))
    floors = np.empty(len(views))
    for i, view in enumerate(views):
        points, radii = _balls(points_of(i))
        seen, around = points @ view.axes.T, np.expand_dims(radii, -1)
        centres[i] = ((seen - around).min(axis=0) + (seen + around).max(axis=0)) / 2 @ view.axes
        floors[i] = (points[:, 1] - radii).min()
    targets = _held(centres, np.mean) if still else smooth(centres, STEADINESS)
    reach = np.array([fitting_distance(points_of(i), targets[i], v, aspect) for i, v in enumerate(views)])
    if still:
        distances, ground = _held(reach, np.max), _held(floors, np.min)
    else:
        distances = smooth(envelope(reach, STEADINESS, np.max), STEADINESS)
        ground = smooth(envelope(floors, FOOTING, np.min), FOOTING)
    return [_framing(*row) for row in zip(views, targets, distances, ground, strict=True)]


def with_room(framing: Framing, stage: Stage) -> Framing:
    """The same with the camera where the stage's own pieces are in the picture too."""
    return replace(framing, camera=stage.seen_by(framing.camera, framing.placement))


def turned(points: AnyArray, angle: float, about_origin: bool = False) -> AnyArray:
    """(N, 3) points turned about the vertical through the middle of their bounds, or directions about y."""
    if angle == 0.0:
        return points
    low, high = points.min(axis=0), points.max(axis=0)
    pivot = np.zeros(3) if about_origin else (low + high) / 2
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray((points - pivot) @ turn.T + pivot)


def fitting_distance(points: Points | Balls, target: Floats, view: View, aspect: float) -> float:
    """The least distance from `target` at which all points, or balls, lie within the margins of the picture.

    A ball lies beside a plane through the lens if its centre is its radius away from it.
    """
    points, radii = _balls(points)
    right, up, back = ((points - target) @ view.axes.T).T
    wide = np.tan(view.field_of_view / 2) * (1 - 2 * view.margin)
    high = wide / aspect
    sideways = back + (np.abs(right) + radii * np.hypot(1.0, wide)) / wide
    upright = back + (np.abs(up) + radii * np.hypot(1.0, high)) / high
    return float(np.maximum(sideways, upright).max())


def _balls(points: Points | Balls) -> Balls:
    return points if isinstance(points, Balls) else Balls(points, np.zeros(len(points)))


def envelope(track: Floats, radius: int, extreme: Callable[[Floats], float]) -> Floats:
    """The extreme of each value's neighbours up to `radius` frames away."""
    return np.array([extreme(track[max(0, i - radius) : i + radius + 1]) for i in range(len(track))])


def smooth(track: Floats, radius: int) -> Floats:
    """A mean over `radius` frames to either side, weighted by a Hann window; over fewer at the ends."""
    window = np.cos(np.linspace(-np.pi / 2, np.pi / 2, 2 * radius + 3)[1:-1]) ** 2
    smoothed = np.empty_like(track)
    for i in range(len(track)):
        first, last = max(0, i - radius), min(len(track), i + radius + 1)
        weights = window[first - i + radius : last - i + radius]
        smoothed[i] = weights @ track[first:last] / weights.sum()
    return smoothed


def _held(track: Floats, choose: Callable[..., Floats]) -> Floats:
    """One value for all frames."""
    return np.broadcast_to(choose(track, axis=0), track.shape)


def _framing(view: View, target: Floats, distance: float, floor: float) -> Framing:
    origin = target + distance * view.axes[2]
    camera = Camera(
        origin=_plain(origin), target=_plain(target), up=(0.0, 1.0, 0.0), field_of_view=view.field_of_view
    )
    size = distance * np.tan(view.field_of_view / 2) / STAGE_HALF_WIDTH
    placement = Placement(origin=_plain([target[0], floor, target[2]]), size=float(size), turn=view.azimuth)
    return Framing(camera, placement)


def _plain(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
