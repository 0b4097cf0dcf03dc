"""Projections: which direction from the camera each place of a picture shows.

Places in a picture are x and y, −1 … 1 from edge to edge, x to the right and y upwards. Directions are
along the camera's axes: right, up and forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.base.render_errors import BadInputError

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
