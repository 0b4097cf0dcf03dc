"""Pictures of land, where data of one level have no velocity, for the globe or plate below their lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flowsculpt import VelocityField
from flowsculpt.api.meshes import Floats

SIZE = (1024, 512)  # pixels around a globe, and from pole to pole
LONGEST = 1024  # pixels of the longer side of a plate

SEA, LAND = (0.011, 0.014, 0.021), (0.06, 0.056, 0.05)
"""Reflectances. Both are dark: colours of the data stand out."""

LEAST, MOST = 0.01, 0.95  # share of what does not move, between which it is land
_ROUNDED = 6  # passes that round the corners of cells


def around_globe(radius: float) -> Floats:
    """Return the points (H, W, 3) of the pixels of a picture around a globe: longitude 0 is in its middle."""
    width, height = SIZE
    east = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    north = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    north, east = np.meshgrid(north, east, indexing="ij")
    along = np.cos(north)
    return radius * np.stack([along * np.sin(east), np.sin(north), along * np.cos(east)], axis=-1)


def over_plate(middle: Floats, sides: Floats, is_level: bool) -> Floats:
    """Return the points (H, W, 3) of the pixels of a picture over a plate.

    is_level  True if the plate lies as a map does, with -z at the top of the picture; else y is there
    """
    up = np.array([0.0, 0.0, -1.0] if is_level else [0.0, 1.0, 0.0])
    wide, high = float(sides[0]), float(np.abs(sides @ up))
    width, height = (max(2, round(LONGEST * side / max(wide, high))) for side in (wide, high))
    across = wide * ((np.arange(width) + 0.5) / width - 0.5)
    along = high * (0.5 - (np.arange(height) + 0.5) / height)
    return np.asarray(middle + across[None, :, None] * np.eye(3)[0] + along[:, None, None] * up)


def land_at(field: VelocityField, points: Floats, inside: np.ndarray | None = None) -> np.ndarray | None:
    """Return a picture (H, W), 1 on land and 0 elsewhere; None where there is none, or hardly anything else.

    points  (H, W, 3) of its pixels
    inside  flags (H, W) of those in the data; None: all
    """
    still = np.zeros(points.shape[:2])
    for row, places in enumerate(points):
        still[row] = ~field.velocity(places, 0.0).any(axis=1)
    if inside is not None:
        still[~inside] = 0.0
    if not LEAST < (still.mean() if inside is None else still[inside].mean()) < MOST:
        return None
    for _ in range(_ROUNDED):
        rows = np.pad(still, ((1, 1), (0, 0)), mode="edge")
        still = (rows[:-2] + 2.0 * rows[1:-1] + rows[2:]) / 4.0
        still = (np.roll(still, 1, axis=1) + 2.0 * still + np.roll(still, -1, axis=1)) / 4.0
    return np.clip(2.5 * (still - 0.5) + 0.5, 0.0, 1.0)


def write_land(land: np.ndarray, path: Path) -> None:
    """Write a picture of land and sea as PNG."""
    from flowsculpt.api.pictures import write_still  # takes a moment

    linear = land[:, :, None] * np.array(LAND) + (1.0 - land[:, :, None]) * np.array(SEA)
    encoded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    write_still(path, np.round(255.0 * encoded).astype(np.uint8))
