"""Cameras with a wide projection: spherical, dome and VR180."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.base.render_errors import BadInputError
from render.scene.projection import LEFT, Projection
from render.scene.render_camera import Camera

Floats = NDArray[np.float64]

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
