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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from render.camera import Camera
from render.plain import from_plain, to_plain
from render.stage import Placement, Stage

if TYPE_CHECKING:
    from pipeline.shot.cameras import Lens, View

STEADINESS = 10
"""Frames to either side over which the camera is smoothed; at 24 a second, about an eye's patience."""

FOOTING = 1
"""Frames to either side over which the floor is smoothed: few, so that the sculpture stands, not hovers."""

HALF_A_SCULPTURE = 100.0
"""Millimetres that count as the sculpture's half-size, where a shot does not say what a unit is: lenses then
blur a small one and its enlarged copy alike."""

UPRIGHT = 1e-6
"""The cosine of an elevation from which on the vertical does not tell which way is up in the picture."""

NEAR, FAR = 1e-2, 1e4
"""Where cameras begin and cease to see, scene units; in scenes that are too small or too large for these, a
tenth of the distance of the target, and a hundred times that."""

DOWN = (0.0, -1.0, 0.0)

AT_ONCE = 4096
"""Points that are looked at together: what is found of them then stays in a core's own memory."""

STAGE_HALF_WIDTH = 1.5
"""Half the width of what the lens sees at its target, in stage units: a sculpture of half-size 1, and air."""


class Balls(NamedTuple):
    """Points (N, 3) of any float type, with something around them: radii (N,), scene units."""

    points: AnyArray
    radii: AnyArray


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
    views: Sequence[View], points_of: Callable[[int], AnyArray | Balls], aspect: float, follow: float = 1.0
) -> list[Framing]:
    """Frame a sequence: `points_of(i)` gives (N, 3) vertices, or balls, that `views[i]` sees.

    Points may be of any float type, and are reckoned with as float64.

    aspect  width to height
    follow  1 goes along with the sculpture; 0 holds the distance, the aim and the floor for the whole
            sequence, as a turntable wants them; in between, partly

    What a view says itself is taken as it is: a target, a distance, a position. The stage stands around the
    sculpture all the same, and is as large as it.
    """
    centres, floors = _survey(views, points_of)
    middles = _between(centres.mean(axis=0), smooth(centres, STEADINESS), follow)
    ground = _between(floors.min(), smooth(envelope(floors, FOOTING, np.min), FOOTING), follow)
    aims = np.array([m if v.target is None else v.target for v, m in zip(views, middles, strict=True)])
    sides = [_side(view, aim) for view, aim in zip(views, aims, strict=True)]
    reach, around = np.empty(len(views)), np.empty(len(views))
    for i, view in enumerate(views):
        points = points_of(i)
        reach[i] = fitting_distance(points, aims[i], sides[i], view, aspect)
        by_itself = view.target is not None
        around[i] = fitting_distance(points, middles[i], sides[i], view, aspect) if by_itself else reach[i]
    half_widths = np.array([np.tan(view.field_of_view / 2) for view in views])
    distances = _between(reach.max(), _beyond(reach), follow)
    sizes = _between((around * half_widths).max(), _beyond(around) * half_widths, follow) / STAGE_HALF_WIDTH
    framings = []
    for i, view in enumerate(views):
        turn = view.azimuth if view.position is None else _bearing(views[0], aims[0])[0]
        x, _, z = middles[i]
        placement = Placement(origin=_plain([x, ground[i], z]), size=float(sizes[i]), turn=turn)
        framings.append(Framing(_camera(view, aims[i], sides[i], distances[i], sizes[i]), placement))
    return framings


def _survey(views: Sequence[View], points_of: Callable[[int], AnyArray | Balls]) -> tuple[Points, Floats]:
    """(T, 3): the middle of what each view sees, by the bounds it has there; and (T,) its lowest height."""
    centres, floors = np.empty((len(views), 3)), np.empty(len(views))
    for i, view in enumerate(views):
        axes = _axes(view.azimuth + view.orbit, view.elevation)
        reach = _furthest(points_of(i), np.vstack([axes, -axes, DOWN]), np.ones(7))
        centres[i] = (reach[:3] - reach[3:6]) / 2 @ axes
        floors[i] = -reach[6]
    return centres, floors


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


def fitting_distance(
    points: AnyArray | Balls, target: Floats, axes: Floats, view: View, aspect: float
) -> float:
    """The least distance from `target` at which all points, or balls, lie within the margins of the picture.

    axes  (3, 3): rows right, up and back, the camera's

    A ball lies beside a plane through the lens if its centre is its radius away from it.
    """
    right, up, back = axes
    wide = np.tan(view.field_of_view / 2) * (1 - 2 * view.margin)
    high = wide / aspect
    sides = np.stack([back + right / wide, back - right / wide, back + up / high, back - up / high])
    slant = np.repeat([np.hypot(1.0, wide) / wide, np.hypot(1.0, high) / high], 2)
    return float((_furthest(points, sides, slant) - sides @ target).max())


def _furthest(points: AnyArray | Balls, ways: Floats, slant: Floats) -> Floats:
    """(K,): how far points, or balls, reach along ways (K, 3), which a radius adds to by `slant` (K,).

    What bounds a picture are planes, so this is all that framing asks of a sculpture.
    """
    centres, radii = points if isinstance(points, Balls) else (points, None)
    reach = np.full(len(ways), -np.inf)
    for some in (slice(i, i + AT_ONCE) for i in range(0, len(centres), AT_ONCE)):
        along = ways @ centres[some].T
        if radii is not None:
            along += slant[:, None] * radii[some]
        np.maximum(reach, along.max(axis=1), out=reach)
    return reach


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


def _beyond(track: Floats) -> Floats:
    """A calm track that is nowhere below another."""
    return smooth(envelope(track, STEADINESS, np.max), STEADINESS)


def _between(held: Floats | float, moving: Floats, follow: float) -> Floats:
    """From one value for all frames, at 0, to a track that follows, at 1."""
    if follow == 1.0:
        return moving
    return np.asarray(held + follow * (moving - held))


def _bearing(view: View, aim: Floats) -> tuple[float, float]:
    """Azimuth and elevation from which a view sees its aim; from the front where it stands in it."""
    if view.position is None:
        return view.azimuth + view.orbit, view.elevation
    x, y, z = np.subtract(view.position, aim)
    return float(np.arctan2(x, z)), float(np.arctan2(y, np.hypot(x, z)))


def _axes(azimuth: float, elevation: float) -> Floats:
    """(3, 3): rows right, up and back of a camera that is not rolled."""
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    return np.array(
        [
            [cos_a, 0.0, -sin_a],
            [-sin_e * sin_a, cos_e, -sin_e * cos_a],
            [cos_e * sin_a, sin_e, cos_e * cos_a],
        ]
    )


def _side(view: View, aim: Floats) -> Floats:
    """(3, 3): the axes of a view's camera, rolled."""
    right, up, back = _axes(*_bearing(view, aim))
    if view.roll == 0.0:
        return np.stack([right, up, back])
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    return np.stack([cos * right - sin * up, cos * up + sin * right, back])


def _camera(view: View, aim: Floats, axes: Floats, distance: float, size: float) -> Camera:
    """The camera of a view at the distance that framing found; `size` is the sculpture's half-size."""
    if view.position is None:
        away = distance * view.dolly if view.distance is None else view.distance
        origin = aim + away * axes[2]
    else:
        origin = np.array(view.position)
        away = float(np.linalg.norm(origin - aim))
    is_upright = view.roll == 0.0 and np.hypot(axes[2][0], axes[2][2]) > UPRIGHT
    return Camera(
        origin=_plain(origin),
        target=_plain(aim if away > 0.0 else origin - axes[2]),
        up=(0.0, 1.0, 0.0) if is_upright else _plain(axes[1]),
        field_of_view=view.field_of_view,
        near=min(NEAR, away / 10.0) if away > 0.0 else NEAR,
        far=max(FAR, 100.0 * away),
        **_blur(view.lens, origin, axes[2], away, size),
    )


def _blur(lens: Lens | None, origin: Floats, back: Floats, away: float, size: float) -> dict[str, float]:
    """How wide a lens opens and how far away it is sharp, scene units; nothing of one sharp everywhere."""
    if lens is None:
        return {}
    unit = HALF_A_SCULPTURE / size if lens.unit is None else lens.unit
    if lens.focus is None:
        sharp = away
    elif isinstance(lens.focus, float):
        sharp = lens.focus
    else:
        sharp = float((origin - lens.focus) @ back)
    return {"lens_radius": float(lens.focal_length / lens.aperture / 2.0 / unit), "focus_distance": sharp}


def _plain(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
