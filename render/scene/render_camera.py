"""Cameras as plain numbers, in scene units; and projections: the directions that places of a picture show.

Places in a picture are x and y, −1 … 1 from edge to edge, x to the right and y upwards. Directions are
along the camera's axes: right, up and forward.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Triple

Floats = NDArray[np.float64]

KINDS = ("perspective", "spherical", "dome", "vr180")
"""The projections that a camera can have."""

LEFT, RIGHT = -1, 1
"""The eyes of a stereo camera: signs of their offsets along its right axis."""


@dataclass(frozen=True)
class Projection:
    """The projection of a picture.

    kind   one of KINDS: "perspective"; "spherical", equirectangular, all directions in a picture twice as
           wide as high; "dome", an equidistant fisheye, a circle in a square; "vr180", half an
           equirectangular picture for each eye, the left eye's on the left
    angle  full angle of the circle of a dome, radians; no other projection has one
    """

    kind: str = "perspective"
    angle: float = math.pi

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise BadInputError(f"projection is {self.kind!r}; it can be {', '.join(KINDS)}")
        if not 0.0 < self.angle <= 2.0 * math.pi:
            raise BadInputError(
                f"a dome has {math.degrees(self.angle):.4g}°; its angle must be above 0° and at most 360°"
            )

    @property
    def is_wide(self) -> bool:
        """True for all but a perspective."""
        return self.kind != "perspective"

    @property
    def is_stereo(self) -> bool:
        """True if the left half of the picture is the left eye's, and the right half the right eye's."""
        return self.kind == "vr180"

    @property
    def wraps(self) -> bool:
        """True if the left and the right edge of the picture are neighbours."""
        return self.kind == "spherical"

    @property
    def aspect(self) -> float | None:
        """Width over height that the picture must have; None for a perspective, which takes any."""
        return {"perspective": None, "dome": 1.0}.get(self.kind, 2.0)

    @property
    def picture_angle(self) -> float:
        """The angle between the left and the right edge of a wide picture, of both eyes together; radians."""
        return self.angle if self.kind == "dome" else 2.0 * math.pi

    def directions(self, places: ArrayLike) -> Floats:
        """Return the unit directions (…, 3) that places (…, 2) of a wide picture show.

        NaN where the picture is black: outside of the circle of a dome.
        """
        x, y = np.moveaxis(np.asarray(places, dtype=np.float64), -1, 0)
        if self.kind == "dome":
            radius = np.hypot(x, y)
            away = np.where(radius <= 1.0, self.angle / 2.0 * radius, np.nan)
            aside = self.angle / 2.0 * np.sinc(away / np.pi)  # sin(away) / radius
            return np.stack([aside * x, aside * y, np.cos(away)], axis=-1)
        longitude = math.pi * x
        if self.is_stereo:
            longitude = longitude - 0.5 * math.pi * self.eyes(x)
        latitude = 0.5 * math.pi * y
        level = np.cos(latitude)
        return np.stack([level * np.sin(longitude), np.sin(latitude), level * np.cos(longitude)], axis=-1)

    def places(self, directions: ArrayLike, eye: ArrayLike = LEFT) -> Floats:
        """Return the places (…, 2) that directions (…, 3) of any length have in a wide picture.

        eye  LEFT or RIGHT, (…): whose half of a stereo picture

        What `shows` refuses has a place outside the circle, or in the other eye's half.
        """
        right, up, forward = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
        if self.kind == "dome":
            aside = np.hypot(right, up)
            away = np.arctan2(aside, forward) / (self.angle / 2.0)
            scale = away / np.where(aside > 0.0, aside, 1.0)
            x = np.where(aside > 0.0, right * scale, away)
            return np.stack([x, up * scale], axis=-1)
        x = np.arctan2(right, forward) / math.pi
        if self.is_stereo:
            x = x + 0.5 * np.asarray(eye)
        return np.stack([x, np.arctan2(up, np.hypot(right, forward)) / (0.5 * math.pi)], axis=-1)

    def shows(self, directions: ArrayLike) -> NDArray[np.bool_]:
        """Tell which directions (…, 3) of any length a wide picture shows."""
        right, up, forward = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
        if self.kind == "dome":
            return np.asarray(np.arctan2(np.hypot(right, up), forward) <= self.angle / 2.0)
        return np.asarray(forward >= 0.0 if self.is_stereo else np.full(forward.shape, True))

    def motion(self, steps: Floats, width: float) -> Floats:
        """Return motion (…, 2) from places to others, the shorter way around a picture that wraps.

        steps  (…, 2), differences of places in a picture `width` wide
        """
        if not self.wraps:
            return steps
        x, y = np.moveaxis(steps, -1, 0)
        return np.stack([(x + width / 2.0) % width - width / 2.0, y], axis=-1)

    def eyes(self, x: ArrayLike) -> Floats:
        """Return whose half of a stereo picture each x (…) lies in, LEFT or RIGHT; 0 in other pictures."""
        x = np.asarray(x, dtype=np.float64)
        return np.where(x < 0.0, float(LEFT), float(RIGHT)) if self.is_stereo else np.zeros_like(x)


PERSPECTIVE = Projection()


def pixel_places(width: int, height: int) -> Floats:
    """Return the places (height, width, 2) of the middles of pixels."""
    x = (2.0 * np.arange(width) + 1.0) / width - 1.0
    y = 1.0 - (2.0 * np.arange(height) + 1.0) / height
    return np.stack(np.meshgrid(x, y), axis=-1)


_NEAREST = 1e-100
"""Distance of the target, scene units, below which squares underflow and the view has no direction."""


@dataclass(frozen=True)
class Camera:
    """A perspective camera.

    origin, target   where it stands and what it looks at, scene units
    up               the direction that points up in the picture
    field_of_view    horizontal, radians
    near, far        clipping distances, scene units
    lens_radius      radius of the aperture, scene units; 0 is a pinhole, sharp everywhere
    focus_distance   distance along the view direction to the plane in focus, scene units
    """

    origin: Triple
    target: Triple
    up: Triple = (0.0, 1.0, 0.0)
    field_of_view: float = math.radians(26.0)
    near: float = 1e-2
    far: float = 1e4
    lens_radius: float = 0.0
    focus_distance: float = 1.0

    def __post_init__(self) -> None:
        lens = (self.field_of_view, self.near, self.far, self.lens_radius, self.focus_distance)
        numbers = (*self.origin, *self.target, *self.up, *lens)
        if not all(math.isfinite(number) for number in numbers):
            raise BadInputError("a camera's numbers must all be finite")
        if not 0.0 < self.field_of_view < math.pi:
            raise BadInputError(
                f"field_of_view is {math.degrees(self.field_of_view):.4g}°; it must lie within 0° … 180°"
            )
        if not 0.0 < self.near < self.far:
            raise BadInputError(f"near is {self.near} and far is {self.far}; 0 < near < far must hold")
        if self.lens_radius < 0.0:
            raise BadInputError(f"lens_radius is {self.lens_radius}; it must be at least 0")
        # Plain numbers: numpy takes twice as long as all else here, and plans build a camera a frame.
        x, y, z = (to - start for to, start in zip(self.target, self.origin, strict=True))
        up_x, up_y, up_z = self.up
        aside = math.hypot(y * up_z - z * up_y, z * up_x - x * up_z, x * up_y - y * up_x)
        distance = math.hypot(x, y, z)
        if distance < _NEAREST or aside <= 1e-9 * distance:
            raise BadInputError(
                f"the camera at {self.origin} has no direction; its target must be off its up axis"
            )

    def axes(self) -> NDArray[np.float64]:
        """Return the unit vectors (3, 3) that point right and up in the picture, and forward."""
        forward = unit(np.subtract(self.target, self.origin))
        right = unit(np.cross(forward, self.up))
        return np.stack([right, np.cross(right, forward), forward])

    @property
    def has_depth_of_field(self) -> bool:
        """Tell whether anything can be out of focus: then every AOV is noisy."""
        return self.lens_radius > 0.0

    @property
    def projection(self) -> Projection:
        """The projection of its pictures."""
        return PERSPECTIVE

    def pixel_size(self, width: int) -> float:
        """Return the width of a pixel at depth 1, in the middle of a picture `width` pixels wide."""
        return 2.0 * math.tan(self.field_of_view / 2.0) / width

    def depths(self, points: ArrayLike, eyes: ArrayLike = LEFT) -> NDArray[np.float64]:
        """Return the depth (…) of points (…, 3), by which pixels grow: from the camera's plane.

        eyes  as of `project`
        """
        return np.asarray((np.asarray(points) - self.origin) @ self.axes()[2])

    def project(self, points: ArrayLike, aspect: float, eyes: ArrayLike = LEFT) -> NDArray[np.float64]:
        """Project points (N, 3): return x and y, −1 … 1 from edge to edge, and depth, (N, 3).

        aspect  the picture's width over its height
        eyes    LEFT or RIGHT, (N,): in whose half of the picture of a stereo camera

        x grows to the right and y upwards; what the picture does not show, such as points behind the camera,
        has a depth below 0 and no meaningful x and y.
        """
        local = (np.asarray(points, dtype=np.float64) - self.origin) @ self.axes().T
        depth = local[:, 2]
        half_width = math.tan(self.field_of_view / 2.0)
        scale = np.where(depth == 0.0, np.inf, depth) * half_width
        return np.stack([local[:, 0] / scale, local[:, 1] / scale * aspect, depth], axis=1)


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector (3,) over its length."""
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def triple(vector: Iterable[float]) -> Triple:
    """Return three numbers as floats."""
    x, y, z = (float(part) for part in vector)
    return x, y, z


SPHERICAL = Projection("spherical")


@dataclass(frozen=True)
class WideCamera(Camera):
    """A camera that shows far more than a perspective can. It is sharp everywhere.

    The target is in the middle of the picture. `field_of_view` is the angle into which framing fits the
    sculpture; it has no influence on the picture.

    wide          the projection
    eye_distance  between the eyes of a stereo camera, scene units. Each is half of it away from the origin,
                  whichever way a pixel looks: parallax is full straight ahead, and fades to the sides
    """

    wide: Projection = SPHERICAL
    eye_distance: float = 0.0
    type: str = field(default="wide", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.wide.is_wide:
            raise BadInputError(f"a wide camera cannot have the projection {self.wide.kind!r}")
        if self.has_depth_of_field:
            raise BadInputError(f"a {self.wide.kind} camera has no depth of field; leave its aperture out")
        if not (math.isfinite(self.eye_distance) and self.eye_distance >= 0.0):
            raise BadInputError(f"eye_distance is {self.eye_distance}; it must be finite and at least 0")

    @property
    def projection(self) -> Projection:
        """The projection of its pictures."""
        return self.wide

    def pixel_size(self, width: int) -> float:
        """Return the width of a pixel at distance 1, in the middle of a picture `width` pixels wide."""
        return self.wide.picture_angle / width

    def depths(self, points: ArrayLike, eyes: ArrayLike = LEFT) -> Floats:
        """Return the distance (…) of points (…, 3) from the eye."""
        return np.asarray(np.linalg.norm(self._from_eyes(points, eyes), axis=-1))

    def project(self, points: ArrayLike, aspect: float, eyes: ArrayLike = LEFT) -> Floats:
        """Project points as `Camera.project` does; their depth is the distance from the eye.

        aspect  has no influence: x and y are those of the projection
        """
        directions = self._from_eyes(points, eyes) @ self.axes().T
        distance = np.linalg.norm(directions, axis=-1)
        depth = np.where(self.wide.shows(directions), distance, -distance)
        return np.concatenate([self.wide.places(directions, eyes), depth[..., None]], axis=-1)

    def _from_eyes(self, points: ArrayLike, eyes: ArrayLike) -> Floats:
        """Return the vectors (…, 3) from the eyes to points (…, 3)."""
        aside = 0.5 * self.eye_distance * np.asarray(eyes, dtype=np.float64)[..., None] * self.axes()[0]
        return np.asarray(points, dtype=np.float64) - self.origin - aside

    def eye(self, eye: int) -> WideCamera:
        """Return the camera moved to the place of an eye, LEFT or RIGHT."""
        x, y, z = 0.5 * self.eye_distance * eye * self.axes()[0]
        moved = [(a + x, b + y, c + z) for a, b, c in (self.origin, self.target)]
        return replace(self, origin=moved[0], target=moved[1])
