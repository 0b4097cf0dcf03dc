"""Automatic framing: the camera and the stage follow the sculpture, calmly.

For each frame the point that shows the sculpture in the middle of the picture, the height of its lowest point
and the distance from which it just fits the safe area are found. The three tracks are smoothed so that the
camera never jumps and nothing leaves the picture: the distance from above, the floor from below. A frame's
camera depends on frames at most `3 * STEADINESS` away, so an edit late in a shot leaves early pictures alone,
and cameras can be found while frames still come.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats
from flowsculpt.pipeline.shot.camera_path import Between
from flowsculpt.render.scene.render_camera import Camera, WideCamera, triple
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot.camera_path import Lens, View, WideLens


DOWN = (0.0, -1.0, 0.0)

BLOCK = 4096
"""Points that are projected together, so that results stay in a core's cache."""

NEAREST = 0.01
"""Least distance of a camera for which widths are compared, over half of what its lens sees at depth 1."""


class BoundingSpheres(NamedTuple):
    """Spheres: centres (N, 3) of any float type, and radii (N,), scene units.

    parts  by the names of several subjects, which of the spheres are theirs
    """

    points: AnyArray
    radii: AnyArray
    parts: Mapping[str, slice] = MappingProxyType({})

    @staticmethod
    def join(extents: Sequence[Extent], names: Iterable[str] = ()) -> Extent:
        """Return points or spheres of subjects as one, with their names if there are several."""
        if len(extents) == 1:
            return extents[0]
        spheres = [
            each if isinstance(each, BoundingSpheres) else BoundingSpheres(each, np.zeros(len(each)))
            for each in extents
        ]
        points, radii = (np.concatenate(column) for column in list(zip(*spheres, strict=True))[:2])
        ends = np.cumsum([0, *(len(each.points) for each in spheres)]).tolist()
        return BoundingSpheres(points, radii, dict(zip(names, map(slice, ends, ends[1:]), strict=False)))

    def of(self, name: str) -> BoundingSpheres:
        """Return the spheres of a subject; all where none has that name."""
        part = self.parts.get(name, slice(None))
        return BoundingSpheres(self.points[part], self.radii[part])


Extent = AnyArray | BoundingSpheres
"""Points (N, 3) of any float type, or spheres; a picture must show them all."""


def place_between(points: Extent, place: Between) -> Floats:
    """Return a place (3,) between the middles of two subjects; of all where they have no names."""
    spheres = (
        points if isinstance(points, BoundingSpheres) else BoundingSpheres(points, np.zeros(len(points)))
    )
    named = (spheres.of(name).points for name in (place.subject, place.other))
    first, second = (0.5 * (part.min(axis=0) + part.max(axis=0)) for part in named)
    return np.asarray(first + place.share * (second - first), np.float64)


def rotate_y(
    points: AnyArray, angle: float, about_origin: bool = False, around: AnyArray | None = None
) -> AnyArray:
    """Turn (N, 3) points about the vertical axis of their bounds, or directions about y.

    around  (M, 3), other points whose bounds have the axis
    """
    if angle == 0.0:
        return points
    bounded = points if around is None else around
    low, high = bounded.min(axis=0), bounded.max(axis=0)
    pivot = np.zeros(3) if about_origin else (low + high) / 2
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray((points - pivot) @ turn.T + pivot)


def bounds(points: Extent, view: View) -> tuple[Floats, float]:
    """Return the centre (3,) of the bounds of points along the axes of a view, and their lowest height."""
    axes = _axes(view.azimuth + view.orbit, view.elevation)
    reach = _extents(points, np.vstack([axes, -axes, DOWN]), np.ones(7))
    return (reach[:3] - reach[3:6]) / 2 @ axes, float(-reach[6])


def picture_centre(points: Extent, middle: Floats, view: View, aspect: float) -> Floats:
    """Return the point (3,) that a camera looks at to show points in the middle of its picture.

    middle  (3,), the centre of their bounds; a camera with a position of its own looks there

    Near parts look larger, so the point is off the middle. Of width and height the larger decides the
    distance; the other is centred as it looks from there.
    """
    if view.position is not None:
        return middle
    axes, extents = _axes(view.azimuth + view.orbit, view.elevation), _half_extents(view, aspect)
    fits, depth = _fits(points, axes, *extents), float(axes[2] @ middle)
    nearest = NEAREST * max(extents)
    away = max(nearest, *(fit.distance - depth for fit in fits))
    wide, high = (
        extent * max(nearest, fit.distance - depth) / away for extent, fit in zip(extents, fits, strict=True)
    )
    right, up = (fit.middle for fit in _fits(points, axes, wide, high))
    return np.array([right, up, depth]) @ axes


class _Fit(NamedTuple):
    """The place from which points just fit between two opposite edges of the picture.

    middle    along the camera's right axis for the left and right edge, along its up axis for the others
    distance  along the camera's back axis
    """

    middle: float
    distance: float


def _fits(points: Extent, axes: Floats, wide: float, high: float) -> tuple[_Fit, _Fit]:
    """Return the places that fit the width and the height, where the lens sees so much at depth 1."""
    right, left, upper, lower = _extents(points, *_edge_planes(axes, wide, high)).tolist()
    return (
        _Fit(wide * (right - left) / 2, (right + left) / 2),
        _Fit(high * (upper - lower) / 2, (upper + lower) / 2),
    )


def fitting_distance(points: Extent, target: Floats, axes: Floats, view: View, aspect: float) -> float:
    """Return the least distance from `target` at which all points or spheres lie within the margins.

    axes  (3, 3): rows right, up and back, the camera's

    A sphere touches a plane through the lens if its centre is its radius away from it.
    """
    planes, slant = _edge_planes(axes, *_half_extents(view, aspect))
    return float((_extents(points, planes, slant) - planes @ target).max())


def _half_extents(view: View, aspect: float) -> tuple[float, float]:
    """Return half the width and half the height of what a view shows within its margins at depth 1.

    A wide projection shows far more: its field of view is an angle in which the sculpture lies.
    """
    wide = float(np.tan(view.field_of_view / 2) * (1 - 2 * view.margin))
    return (wide, wide / aspect) if view.wide is None else (wide, wide)


def _edge_planes(axes: Floats, wide: float, high: float) -> tuple[Floats, Floats]:
    """Return normals (4, 3) of the planes through the lens and an edge of the picture; and their lengths.

    The planes are those of the right, left, upper and lower edge. Normals are 1 along the back axis.
    """
    right, up, back = axes
    planes = np.stack([back + right / wide, back - right / wide, back + up / high, back - up / high])
    return planes, np.repeat([np.hypot(1.0, wide) / wide, np.hypot(1.0, high) / high], 2)


def _extents(points: Extent, directions: Floats, slant: Floats) -> Floats:
    """Return (K,) the extents of points or spheres along directions (K, 3); radii count `slant` (K,) times.

    Planes bound a picture, so framing needs nothing else.
    """
    centres, radii = points[:2] if isinstance(points, BoundingSpheres) else (points, None)
    reach = np.full(len(directions), -np.inf)
    for some in (slice(i, i + BLOCK) for i in range(0, len(centres), BLOCK)):
        along = directions @ centres[some].T
        if radii is not None:
            along += slant[:, None] * radii[some]
        np.maximum(reach, along.max(axis=1), out=reach)
    return reach


def landscape(view: View, aspect: float) -> View:
    """Return a view of an upright picture as that of a wide one: the camera turned back from its side."""
    if aspect >= 1.0 or view.wide is not None:
        return view
    return view._replace(field_of_view=2.0 * float(np.arctan(np.tan(view.field_of_view / 2) / aspect)))


def bearing(view: View, aim: Floats) -> tuple[float, float]:
    """Return azimuth and elevation of the camera seen from its look-at point, radians."""
    if view.position is None:
        return view.azimuth + view.orbit, view.elevation
    x, y, z = np.subtract(view.position, aim)
    return float(np.arctan2(x, z)), float(np.arctan2(y, np.hypot(x, z)))


def _axes(azimuth: float, elevation: float) -> Floats:
    """Return (3, 3): rows right, up and back of a camera without roll."""
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    return np.array(
        [[cos_a, 0.0, -sin_a], [-sin_e * sin_a, cos_e, -sin_e * cos_a], [cos_e * sin_a, sin_e, cos_e * cos_a]]
    )


def axes_of(view: View, aim: Floats) -> Floats:
    """Return (3, 3): the axes of a view's camera, with roll."""
    right, up, back = _axes(*bearing(view, aim))
    if view.roll == 0.0:
        return np.stack([right, up, back])
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    return np.stack([cos * right - sin * up, cos * up + sin * right, back])


STEADINESS = 10
"""Frames to either side over which the camera is smoothed: even; at 24 a second, about an eye's patience."""

FOOTING = 1
"""Frames to either side over which the floor is smoothed: few, so that the sculpture stands, not hovers."""

AHEAD = 3 * STEADINESS
"""Frames after one that its camera depends on: the distance is smoothed from above, around aims that are."""

STAGE_ASPECT = 16 / 9
"""Width to height of the picture whose frame gives the stage its size, so that one light falls on a sculpture
whatever the shape of the picture."""

FARTHEST = 1.4
"""Distance of a camera over that for STAGE_ASPECT beyond which the stage grows with it, or the camera would
stand behind its wall: in pictures longer than 2.5:1."""

STAGE_HALF_WIDTH = 1.5
"""Half the width of what the lens sees at its target, in stage units: a sculpture of half-size 1, and air."""

HALF_A_SCULPTURE = 100.0
"""Millimetres that count as the sculpture's half-size, where a shot does not say what a unit is: lenses then
blur a small one and its enlarged copy alike."""

HALF_A_STEREO_SCULPTURE = 1000.0
"""Millimetres that count as the half-size for a stereo camera: a sculpture of 200 mm that fills the view
would be too near for eyes at their true distance."""

UPRIGHT = 1e-6
"""Below this cosine of its elevation a camera looks straight up or down, and its own up axis is used."""

NEAR, FAR = 1e-2, 1e4
"""Near and far clipping distance of cameras, scene units; in scenes too small or too large for these, a tenth
of the distance of the target, and a hundred times that."""


@dataclass(frozen=True)
class Framing:
    """One frame's camera, and where the stage stands for it."""

    camera: Camera | WideCamera
    placement: StagePlacement

    def with_stage_in_view(self, stage: Stage, aspect: float | None) -> Framing:
        """Move the camera until the stage's reference objects are in the picture too; see `camera_move`."""
        return replace(self, camera=stage.adjusted_camera(self.camera, self.placement, aspect))


class Framer:
    """Finds the cameras of a sequence, also while its frames come.

    What a view says itself is taken as it is: a target, a distance, a position. The stage stands around the
    sculpture all the same, and is as large as it.
    """

    AHEAD: ClassVar[int] = AHEAD
    """Frames after one that its camera depends on."""

    def __init__(
        self,
        views: Sequence[View],
        points_of: Callable[[int], Extent],
        aspect: float,
        follow: float = 1.0,
        is_round: bool = False,
    ) -> None:
        """Frame a sequence: `points_of(i)` gives what `views[i]` sees; it is computed with as float64.

        aspect  width to height
        follow  1 goes along with the sculpture; 0 holds the distance, the aim and the floor for the whole
                sequence, as a turned object wants them; in between, partly
        is_round  True if the first frame follows the last, so that the camera is as calm there
        """
        self._count, self._lead = len(views), AHEAD if is_round else 0
        if is_round:  # frames of the rounds before and after are framed too
            count, of_round = len(views), points_of
            views = [views[i % count] for i in range(-AHEAD, count + AHEAD)]

            def points_of(i: int) -> Extent:
                return of_round((i - AHEAD) % count)

        many = len(views)
        self._views, self._points_of, self._aspect, self._follow = views, points_of, aspect, follow
        self._landscapes = [landscape(view, aspect) for view in views]
        self._half_widths = np.array([np.tan(view.field_of_view / 2) for view in self._landscapes])
        self._boxes, self._centres, self._floors = np.zeros((many, 3)), np.zeros((many, 3)), np.zeros(many)
        self._middles, self._aims, self._goals = (np.zeros((many, 3)) for _ in range(3))
        self._sides = np.zeros((many, 3, 3))
        self._reach, self._around, self._fronts = np.zeros(many), np.zeros(many), np.zeros(many)
        self._surveyed = self._aimed = self._given = 0

    def all(self) -> list[Framing]:
        """Return the framings of all frames."""
        return self.framings(self._count)

    def framings(self, come: int) -> list[Framing]:
        """Return the framings that the first `come` frames determine, without those returned before.

        If the camera does not follow the sculpture, or in a round, there is none before all frames have come.
        """
        if self._lead:
            if come < self._count:
                return []
            come = len(self._views)
        self._survey(come)
        whole = come == len(self._views)
        if not whole and self._follow != 1.0:
            return []
        self._aim(come if whole else come - STEADINESS)
        placed = self._place(come if whole else come - AHEAD)
        return placed[self._lead : self._lead + self._count] if self._lead else placed

    def _survey(self, come: int) -> None:
        for i in range(self._surveyed, come):
            points, view = self._points_of(i), self._views[i]
            self._boxes[i], self._floors[i] = bounds(points, view)
            self._centres[i] = picture_centre(points, self._boxes[i], view, self._aspect)
            if isinstance(view.target, Between):
                self._goals[i] = place_between(points, view.target)
        self._surveyed = come

    def _aim(self, last: int) -> None:
        """Find the look-at points up to frame `last`, and the least distances to them."""
        first = self._aimed
        last = self._aimed = max(first, last)
        self._middles[first:last] = self._calm_part(self._boxes, first, last)
        centres, goals = (self._calm_part(track, first, last) for track in (self._centres, self._goals))
        for i in range(first, last):
            view, centre, points = self._views[i], centres[i - first], self._points_of(i)
            given = goals[i - first] if isinstance(view.target, Between) else view.target
            aim = self._aims[i] = centre if given is None else np.array(given)
            side = self._sides[i] = axes_of(view, aim)
            self._reach[i] = self._around[i] = fitting_distance(points, aim, side, view, self._aspect)
            if view.blur is not None and isinstance(view.blur.focus, str):
                named = points.of(view.blur.focus) if isinstance(points, BoundingSpheres) else points
                self._fronts[i] = _extents(named, side[2:], np.ones(1))[0] - side[2] @ aim
            if view.target is not None or self._aspect != STAGE_ASPECT:
                wide = self._landscapes[i]
                self._around[i] = fitting_distance(points, centre, side, wide, STAGE_ASPECT)
            if self._aspect != STAGE_ASPECT and view.wide is None:
                away = fitting_distance(points, centre, side, view, self._aspect)
                self._around[i] = max(self._around[i], away / FARTHEST)

    def _calm_part(self, track: Floats, first: int, last: int) -> Floats:
        moving = _part(track[: self._surveyed], first, last, STEADINESS, _calm)
        return _between(track.mean(axis=0), moving, self._follow)

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
        fronts = _part(self._fronts[: self._aimed], first, last, STEADINESS, _calm)
        tracks = zip(ground, distances, sizes.tolist(), fronts.tolist(), strict=True)
        return [self._framing(i, *track) for i, track in zip(range(first, last), tracks, strict=True)]

    def _framing(self, i: int, ground: float, distance: float, size: float, front: float) -> Framing:
        view, (x, _, z) = self._views[i], self._middles[i]
        turn = (
            view.azimuth
            if view.position is None
            else bearing(self._views[self._lead], self._aims[self._lead])[0]
        )
        placement = StagePlacement(origin=triple([x, ground, z]), size=size, turn=turn)
        camera = camera_of(view, self._aims[i], self._sides[i], distance, size, front)
        return Framing(camera, placement)


# Tracks


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


_calm = partial(smooth, radius=STEADINESS)


def _beyond(track: Floats) -> Floats:
    """Return a smooth track that is nowhere below another, and close to it.

    The smoothed track is raised by the smoothed envelope of what exceeds it. Where a sculpture grows steadily
    that is little; an envelope of the track itself would be as far ahead as its radius.
    """
    calm = _calm(track)
    return calm + smooth(envelope(track - calm, STEADINESS // 2, np.max), STEADINESS // 2)


def _standing(track: Floats) -> Floats:
    """Return a smooth track that is nowhere above another."""
    return smooth(envelope(track, FOOTING, np.min), FOOTING)


def _between(held: Floats | float, moving: Floats, follow: float) -> Floats:
    """Interpolate from one value for all frames (`follow` 0) to a moving track (`follow` 1)."""
    if follow == 1.0:
        return moving
    return np.asarray(held + follow * (moving - held))


def camera_of(
    view: View, aim: Floats, axes: Floats, distance: float, size: float, front: float = 0.0
) -> Camera | WideCamera:
    """Return the camera of a view at a distance.

    size   the half-size of the sculpture
    front  how far the sculpture, or the subject in focus, reaches from `aim` towards the camera
    """
    if view.position is None:
        away = distance * view.dolly if view.distance is None else view.distance
        origin = aim + away * axes[2]
    else:
        origin = np.array(view.position)
        away = float(np.linalg.norm(origin - aim))
    is_upright = view.roll == 0.0 and np.hypot(axes[2][0], axes[2][2]) > UPRIGHT
    place: dict[str, Any] = {
        "origin": triple(origin),
        "target": triple(aim if away > 0.0 else origin - axes[2]),
        "up": (0.0, 1.0, 0.0) if is_upright else triple(axes[1]),
        "field_of_view": view.field_of_view,
        "near": min(NEAR, away / 10.0) if away > 0.0 else NEAR,
        "far": max(FAR, 100.0 * away),
    }
    if view.wide is not None:
        return WideCamera(**{**place, **_lifted(view.wide, origin, axes, away)}, **_wide(view.wide, size))
    return Camera(**place, **_blur(view.blur, origin, axes[2], away, size, front))


def _lifted(lens: WideLens, origin: Floats, axes: Floats, away: float) -> dict[str, Any]:
    """Return target and up direction of a camera that looks higher than at its target."""
    if lens.lift == 0.0 or away == 0.0:
        return {}
    cosine, sine = np.cos(lens.lift), np.sin(lens.lift)
    forward, up = sine * axes[1] - cosine * axes[2], cosine * axes[1] + sine * axes[2]
    return {"target": triple(origin + away * forward), "up": triple(up)}


def _wide(lens: WideLens, size: float) -> dict[str, Any]:
    """Return the projection and the distance of the eyes, scene units; `size` as of `camera_of`."""
    unit = HALF_A_STEREO_SCULPTURE / size if lens.unit is None else lens.unit
    return {"wide": lens.projection, "eye_distance": lens.eye_distance / unit}


def _blur(
    lens: Lens | None, origin: Floats, back: Floats, away: float, size: float, front: float
) -> dict[str, Any]:
    """Return the lens radius and the focus distance, scene units; nothing for a pinhole camera."""
    if lens is None:
        return {}
    unit = HALF_A_SCULPTURE / size if lens.unit is None else lens.unit
    if lens.focus is None:
        sharp = away
    elif isinstance(lens.focus, str):
        sharp = away - front
    elif isinstance(lens.focus, float):
        sharp = lens.focus
    else:
        sharp = float((origin - lens.focus) @ back)
    return {"lens_radius": float(lens.focal_length / lens.aperture / 2.0 / unit), "focus_distance": sharp}
