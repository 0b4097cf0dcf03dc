"""Standard attributes of an EXR: windows, camera, frame rate and timecode."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from render.scene.render_camera import Camera

MOST_FRAME_DIGITS = 40
"""Frames that a timeCode can count within a second: its tens have two bits."""


@dataclass(frozen=True)
class ExrAttributes:
    """Attributes of the OpenEXR standard that describe one picture.

    whole     width and height of the whole picture, the display window; None for that of the pixels
    corner    upper left pixel of the data window in it, where the file holds a crop
    camera    gives `worldToCamera`; a perspective one `worldToNDC`, and a spherical one `envmap` where the
              file holds the whole picture; or None
    rate      frames per second, or None
    timecode  HH:MM:SS:FF, or empty
    """

    whole: tuple[int, int] | None = None
    corner: tuple[int, int] = (0, 0)
    camera: Camera | None = None
    rate: Fraction | None = None
    timecode: str = ""

    def entries(self, size: tuple[int, int]) -> dict[str, Any]:
        """Return the header entries of a file with the pixels (width, height) of `size`, by name."""
        whole, corner = np.array(self.whole or size, np.int32), np.array(self.corner, np.int32)
        entries: dict[str, Any] = {
            "displayWindow": (np.zeros(2, np.int32), whole - 1),
            "dataWindow": (corner, corner + np.array(size, np.int32) - 1),
        }
        if self.rate is not None:
            entries["framesPerSecond"] = self.rate
        if self.timecode and int(self.timecode[-2:]) < MOST_FRAME_DIGITS:
            entries["timeCode"] = OpenEXR.TimeCode(*map(int, self.timecode.split(":")), *[0] * 14)
        if self.camera is not None:
            camera = self.camera
            entries["worldToCamera"] = world_to_camera(camera).astype(np.float32)
            if not camera.projection.is_wide:
                aspect = float(whole[0] / whole[1])
                entries["worldToNDC"] = world_to_ndc(camera, aspect).astype(np.float32)
            if camera.projection.kind == "spherical" and tuple(whole) == size:
                entries["envmap"] = OpenEXR.ENVMAP_LATLONG
        return entries


def world_to_camera(camera: Camera) -> NDArray[np.float64]:
    """Return the matrix (4, 4) that takes row vectors to right, up and forward of the camera."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.axes().T
    matrix[3, :3] = -np.asarray(camera.origin) @ matrix[:3, :3]
    return matrix


def world_to_ndc(camera: Camera, aspect: float) -> NDArray[np.float64]:
    """Return the matrix (4, 4) that takes row vectors, after division by w, to the picture.

    (0, 0) is its upper left corner and (1, 1) its lower right, as in OpenEXR and RenderMan.
    """
    half_width = math.tan(camera.field_of_view / 2.0)
    to_far = camera.far / (camera.far - camera.near)
    projection = np.array(
        [
            [0.5 / half_width, 0.0, 0.0, 0.0],
            [0.0, -0.5 * aspect / half_width, 0.0, 0.0],
            [0.5, 0.5, to_far, 1.0],
            [0.0, 0.0, -camera.near * to_far, 0.0],
        ]
    )
    return world_to_camera(camera) @ projection
