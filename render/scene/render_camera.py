"""A camera as plain numbers, in scene units."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.base.render_errors import BadInputError
from render.base.serialise import Triple
from render.scene.projection import LEFT, PERSPECTIVE, Projection

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
