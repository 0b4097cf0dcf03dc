"""What a lookdev supervisor judges a picture by: a grey ball, a chrome one and a colour chart.

They stand on the floor in the lower corners of the picture, always as large, and never before a subject that
keeps its margins: below it the stage has the camera leave room for them (`Stage.seen_by`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from render.scene.camera import Camera
from render.scene.stage import Placement
from render.scene.surface import Surface

HALF = 0.12
"""Half the height of each piece, as a share of half the picture's."""

LEVEL, AIR = -0.83, 0.04
"""Where their middles are between the picture's middle (0) and its lower edge (−1), and how far they keep
from its sides and from each other."""

GREY, CHROME = 0.18, 0.9
"""What the balls reflect."""

BOARD, GAP = (0.03, 0.03, 0.03), 0.14
"""Between the patches of the chart is this, as wide as this share of theirs."""

_SRGB = (
    ((115, 82, 68), (194, 150, 130), (98, 122, 157), (87, 108, 67), (133, 128, 177), (103, 189, 170)),
    ((214, 126, 44), (80, 91, 166), (193, 90, 99), (94, 60, 108), (157, 188, 64), (224, 163, 46)),
    ((56, 61, 150), (70, 148, 73), (175, 54, 60), (231, 199, 31), (187, 86, 149), (8, 133, 161)),
    ((243, 243, 242), (200, 200, 200), (160, 160, 160), (122, 122, 121), (85, 85, 85), (52, 52, 52)),
)
"""The 24 patches of the ColorChecker (McCamy, Marcus and Davidson 1976) from dark skin to black, in 8-bit
sRGB, as its maker published them; see D. Pascale,
"RGB coordinates of the Macbeth ColorChecker", 2006, table 1."""


@dataclass(frozen=True)
class Spot:
    """Where a piece stands: its middle and half its height, scene units."""

    middle: NDArray[np.float64]
    half: float


def chart_colours() -> NDArray[np.float64]:
    """(4, 6, 3): the patches' reflectances, linear Rec.709, by IEC 61966-2-1."""
    shown = np.array(_SRGB) / 255.0
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def spots(camera: Camera, placement: Placement, aspect: float) -> tuple[Spot, Spot, Spot]:
    """Of the grey ball, the chrome ball and the chart."""
    wide = HALF / aspect
    grey = -1.0 + AIR / aspect + wide
    chrome = grey + 2.0 * wide + AIR / aspect
    chart = 1.0 - AIR / aspect - 1.5 * wide
    x, y, z = (_spot(camera, placement, aspect, across) for across in (grey, chrome, chart))
    return x, y, z


def ball(spot: Spot) -> Surface:
    """A sphere as fine as its outline shows."""
    normals, faces = _sphere()
    vertices = spot.middle + spot.half * normals
    return Surface(vertices.astype(np.float32), normals.astype(np.float32), faces)


def chart(spot: Spot, camera: Camera) -> Surface:
    """A board that faces the camera, half as wide again as high, with an attribute `colour`."""
    right, up, forward = camera.axes()
    step = 2.0 / (4.0 + 5.0 * GAP)
    width = step * (6.0 + 7.0 * GAP) / 2.0
    corners = [np.array([[-width, -1.0], [width, -1.0], [width, 1.0], [-width, 1.0]])]
    colours, lifts = [np.array(BOARD)], [0.0]
    patches = chart_colours()
    for row in range(4):
        for column in range(6):
            left = -width + step * (GAP + column * (1.0 + GAP))
            low = 1.0 - step * ((row + 1) * (1.0 + GAP))
            corners.append(
                np.array([[left, low], [left + step, low], [left + step, low + step], [left, low + step]])
            )
            colours.append(patches[row, column])
            lifts.append(2e-3)
    flat = np.concatenate(corners)
    vertices = spot.middle + spot.half * (flat[:, :1] * right + flat[:, 1:] * up)
    vertices = vertices - spot.half * np.repeat(lifts, 4)[:, None] * forward
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (quad[None] + 4 * np.arange(len(corners))[:, None, None]).reshape(-1, 3)
    return Surface(
        vertices.astype(np.float32),
        np.tile(-forward, (len(vertices), 1)).astype(np.float32),
        faces.astype(np.int32),
        {"colour": np.repeat(colours, 4, axis=0).astype(np.float32)},
    )


def _spot(camera: Camera, placement: Placement, aspect: float, across: float) -> Spot:
    """On the floor, where the picture has that place; in the air where the floor is too near or too far."""
    right, up, forward = camera.axes()
    wide = math.tan(camera.field_of_view / 2.0)
    ray = forward + wide * across * right + wide / aspect * LEVEL * up
    half = wide / aspect * HALF
    distance = float(np.linalg.norm(np.subtract(camera.target, camera.origin)))
    above, falling = camera.origin[1] - placement.origin[1], half - ray[1]
    depth = above / falling if falling > 0.0 else math.inf
    depth = min(max(depth, 0.5 * distance), 0.95 * distance)
    return Spot(np.array(camera.origin) + depth * ray, depth * half)


@cache
def _sphere(rings: int = 48, sides: int = 96) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points (V, 3) of the unit sphere and faces (F, 3)."""
    down = np.linspace(0.0, math.pi, rings + 1)[:, None]
    around = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)[None, :]
    points = np.stack(
        np.broadcast_arrays(np.sin(down) * np.sin(around), np.cos(down), np.sin(down) * np.cos(around)), -1
    ).reshape(-1, 3)
    i, j = np.arange(rings)[:, None] * sides, np.arange(sides)[None, :]
    k = (j + 1) % sides
    first = np.stack([i + j, i + sides + j, i + sides + k], -1)[:-1]  # at the poles they would have no area
    second = np.stack([i + j, i + sides + k, i + k], -1)[1:]
    return points, np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
