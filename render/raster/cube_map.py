"""Pictures with a wide projection from flat ones: the faces of a cube around the camera, resampled.

The quick preview draws triangles with straight edges, which a wide projection bends.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.projection import LEFT, RIGHT, pixel_places
from render.scene.render_camera import Camera
from render.scene.wide_camera import WideCamera

Picture = NDArray[np.float32]
Floats = NDArray[np.float64]

FACES = (
    ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
)
"""View direction and up direction of each face, along the axes of the wide camera: right, up and forward."""

_BORDER = 2
"""Pixels of a face beyond its edges, from which places at the edges are interpolated."""


def wide_picture(
    camera: WideCamera, size: tuple[int, int], draw: Callable[[Camera, tuple[int, int]], Picture]
) -> Picture:
    """Return the picture (H, W, 3) of a wide camera, black where its projection shows nothing.

    size  width and height in pixels
    draw  returns the picture (side, side, 3) of a perspective camera; it is called once for each face of the
          cube that is seen, and each eye
    """
    places = pixel_places(*size)
    directions, eyes = camera.wide.directions(places), camera.wide.eyes(places[..., 0])
    shown = np.isfinite(directions[..., 0])
    inner = max(8, math.ceil(2.0 / camera.pixel_size(size[0])))  # as fine as the middle of the picture
    face_of = np.argmax(np.where(shown[..., None], directions, 0.0) @ np.array(FACES)[:, 0].T, axis=-1)
    picture = np.zeros((*shown.shape, 3), dtype=np.float32)
    for eye in (LEFT, RIGHT) if camera.wide.is_stereo else (0,):
        for index, (forward, up) in enumerate(FACES):
            seen = shown & (face_of == index) & (eyes == eye)
            if seen.any():
                face = _face_camera(camera.eye(eye), forward, up, inner)
                drawn = draw(face, (inner + 2 * _BORDER,) * 2)
                picture[seen] = _sampled(drawn, directions[seen], np.array(forward), np.array(up), inner)
    return picture


def _face_camera(camera: WideCamera, forward: Triple, up: Triple, inner: int) -> Camera:
    """Return the camera of a face of `inner` pixels along its side, and its border beyond them."""
    right_up_forward, origin = camera.axes(), camera.origin
    ahead, upwards = (np.array(each) @ right_up_forward for each in (forward, up))
    (x, y, z), (a, b, c) = (np.array(origin) + ahead).tolist(), upwards.tolist()
    angle = 2.0 * math.atan(1.0 + 2.0 * _BORDER / inner)
    return Camera(origin, (x, y, z), (a, b, c), angle, near=camera.near, far=camera.far)


def _sampled(drawn: Picture, directions: Floats, forward: Floats, up: Floats, inner: int) -> Picture:
    """Return values (N, 3) of a face's picture in directions (N, 3), interpolated bilinearly."""
    depth, right = directions @ forward, np.cross(up, forward)
    column = 0.5 * inner * (1.0 + directions @ right / depth) - 0.5 + _BORDER
    row = 0.5 * inner * (1.0 - directions @ up / depth) - 0.5 + _BORDER
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    u, v = (column - left)[:, None], (row - top)[:, None]
    upper = drawn[top, left] * (1.0 - u) + drawn[top, left + 1] * u
    lower = drawn[top + 1, left] * (1.0 - u) + drawn[top + 1, left + 1] * u
    return np.asarray(upper * (1.0 - v) + lower * v, dtype=np.float32)
