"""Quick previews of wide cameras: flat pictures around the camera, put together without a seam."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from flowsculpt.render.raster import wide_picture
from flowsculpt.render.scene.render_camera import Camera, Projection, WideCamera, pixel_places


@pytest.mark.parametrize("kind", ["spherical", "dome", "vr180"])
def test_each_pixel_shows_the_direction_that_its_projection_says(kind: str) -> None:
    camera = WideCamera((1.0, 2.0, 3.0), (0.0, 2.5, -4.0), wide=Projection(kind))
    size = (96, 96) if kind == "dome" else (96, 48)

    def draw(face: Camera, side: tuple[int, int]) -> NDArray[np.float32]:
        """Draw directions in the scene as colours."""
        x, y = np.moveaxis(pixel_places(*side) * math.tan(face.field_of_view / 2.0), -1, 0)
        directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ face.axes()
        return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32)

    picture = wide_picture(camera, size, draw)
    expected = camera.wide.directions(pixel_places(*size)) @ camera.axes()
    assert np.abs(picture - np.nan_to_num(expected)).max() < 5e-3


def test_each_eye_draws_from_its_own_place() -> None:
    camera = WideCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), wide=Projection("vr180"), eye_distance=0.5)

    def draw(face: Camera, side: tuple[int, int]) -> NDArray[np.float32]:
        """Draw the place of the camera as a colour."""
        return np.full((side[1], side[0], 3), face.origin, np.float32)

    picture = wide_picture(camera, (32, 16), draw)
    assert picture[:, :16, 0] == pytest.approx(-0.25) and picture[:, 16:, 0] == pytest.approx(0.25)
