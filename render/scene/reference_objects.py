"""Reference objects of look development: a grey ball, a chrome ball and a colour chart.

They are on the floor in the lower corners of the picture, always of the same size, and never in front of a
subject that keeps its margins: the stage moves the camera to leave space for them (`Stage.adjusted_camera`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.rgb_spaces import linear_of_srgb
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.surface import Surface

HALF_HEIGHT = 0.12
"""Half the height of each object, over half the shorter side of the picture."""

LEVEL, SPACING = -0.83, 0.04
"""Vertical position of their middles, from 0 (picture's middle) to −1 (lower edge) of a picture that is not
upright, and their distance from the picture's sides and from each other."""

GREY, CHROME = 0.18, 0.9
"""Reflectances of the balls."""

BOARD, GAP = (0.03, 0.03, 0.03), 0.14
"""Reflectance of the chart's board, and the gap between patches over the width of a patch."""

_SRGB = (
    ((115, 82, 68), (194, 150, 130), (98, 122, 157), (87, 108, 67), (133, 128, 177), (103, 189, 170)),
    ((214, 126, 44), (80, 91, 166), (193, 90, 99), (94, 60, 108), (157, 188, 64), (224, 163, 46)),
    ((56, 61, 150), (70, 148, 73), (175, 54, 60), (231, 199, 31), (187, 86, 149), (8, 133, 161)),
    ((243, 243, 242), (200, 200, 200), (160, 160, 160), (122, 122, 121), (85, 85, 85), (52, 52, 52)),
)
"""The 24 patches of the ColorChecker (McCamy, Marcus and Davidson 1976) from dark skin to black, in the 8-bit
sRGB values of its maker; see D. Pascale, "RGB coordinates of the Macbeth ColorChecker", 2006, table 1."""


@dataclass(frozen=True)
class ObjectPosition:
    """The position of a reference object: its middle (3,) and half its height, scene units."""

    middle: NDArray[np.float64]
    half: float


def chart_colours() -> NDArray[np.float64]:
    """Return the patches' linear Rec.709 reflectances (4, 6, 3)."""
    return linear_of_srgb(np.array(_SRGB) / 255.0)


def positions(
    camera: Camera, placement: StagePlacement, aspect: float
) -> tuple[ObjectPosition, ObjectPosition, ObjectPosition]:
    """Return the positions of the grey ball, the chrome ball and the chart."""
    shorter = min(1.0, aspect)
    wide, spacing = HALF_HEIGHT * shorter / aspect, SPACING * shorter / aspect
    grey = -1.0 + spacing + wide
    chrome = grey + 2.0 * wide + spacing
    chart = 1.0 - spacing - 1.5 * wide
    x, y, z = (_position(camera, placement, aspect, across) for across in (grey, chrome, chart))
    return x, y, z


def ball(position: ObjectPosition) -> Surface:
    """Return a sphere whose outline looks round."""
    normals, faces = _sphere()
    vertices = position.middle + position.half * normals
    return Surface(vertices.astype(np.float32), normals.astype(np.float32), faces)


def chart(position: ObjectPosition, camera: Camera) -> Surface:
    """Return a board that faces the camera, with proportions of 3:2 and the vertex attribute `colour`."""
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
    vertices = position.middle + position.half * (flat[:, :1] * right + flat[:, 1:] * up)
    vertices = vertices - position.half * np.repeat(lifts, 4)[:, None] * forward
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (quad[None] + 4 * np.arange(len(corners))[:, None, None]).reshape(-1, 3)
    return Surface(
        vertices.astype(np.float32),
        np.tile(-forward, (len(vertices), 1)).astype(np.float32),
        faces.astype(np.int32),
        {"colour": np.repeat(colours, 4, axis=0).astype(np.float32)},
    )


def _position(camera: Camera, placement: StagePlacement, aspect: float, across: float) -> ObjectPosition:
    """Return the floor position at `across` and LEVEL in the picture, or one in the air if that is too near
    or too far.
    """
    right, up, forward = camera.axes()
    wide, shorter = math.tan(camera.field_of_view / 2.0), min(1.0, aspect)
    level = shorter * LEVEL - (1.0 - shorter)
    ray = forward + wide * across * right + wide / aspect * level * up
    half = wide / aspect * HALF_HEIGHT * shorter
    distance = float(np.linalg.norm(np.subtract(camera.target, camera.origin)))
    above, falling = camera.origin[1] - placement.origin[1], half - ray[1]
    depth = above / falling if falling > 0.0 else math.inf
    depth = min(max(depth, 0.5 * distance), 0.95 * distance)
    return ObjectPosition(np.array(camera.origin) + depth * ray, depth * half)


@cache
def _sphere(rings: int = 48, sides: int = 96) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return points (V, 3) and faces (F, 3) of the unit sphere."""
    down = np.linspace(0.0, math.pi, rings + 1)[:, None]
    angle = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)[None, :]
    points = np.stack(
        np.broadcast_arrays(np.sin(down) * np.sin(angle), np.cos(down), np.sin(down) * np.cos(angle)), -1
    ).reshape(-1, 3)
    i, j = np.arange(rings)[:, None] * sides, np.arange(sides)[None, :]
    k = (j + 1) % sides
    first = np.stack([i + j, i + sides + j, i + sides + k], -1)[:-1]  # without area at the poles
    second = np.stack([i + j, i + sides + k, i + k], -1)[1:]
    return points, np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
