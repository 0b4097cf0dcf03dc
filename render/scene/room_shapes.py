"""Shapes of stages that are places: rooms with flat walls, and what stands in them, in stage units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.serialise import Triple

Mesh = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]
"""Vertices (V, 3), normals (V, 3) and faces (F, 3)."""

Floats = NDArray[np.float64]

ROOMS = ("corner", "window", "shelf")
"""Kinds of stages whose backdrop is flat."""

BEVEL = 0.025
"""Radius of a plinth's edges, stage units: rounded edges catch the light."""

_GRID = 0.6
"""Largest step between vertices of walls and floors: previews interpolate light between them."""

HIGH, _FAR = 9.0, 13.0
"""Height of walls that leave the picture, and how far they and floors go."""

_CORNER, _LEFT, _RIGHT = (-1.5, -2.8), (-0.42, 0.91), (0.985, 0.17)
"""Place (x, z) of a corner in the plan, and the directions of its two walls, which meet at 105°."""

_WALL = -2.5
"""Place z of the wall that a window's light crosses."""


class Window(NamedTuple):
    """A window that is outside of the picture, in a wall across the way of a light.

    light, target  place of the light, and where its middle falls
    panes, pane    panes across and up, and their width and height
    bar, board     width of the bars between, and half the size of the wall around
    share          of the way from target to light at which it is
    has_hood       True for walls from its edges back to the light, so that no light passes by
    """

    light: Triple
    target: Triple
    panes: tuple[int, int]
    pane: tuple[float, float]
    bar: float
    board: float
    share: float = 0.5
    has_hood: bool = False

    @property
    def opening(self) -> float:
        """Tangent of half the angle of a cone around all light through the panes, twice as wide as needed."""
        half = math.hypot(*(0.5 * count * size for count, size in zip(self.panes, self.pane, strict=True)))
        return 2.0 * half / ((1.0 - self.share) * math.dist(self.light, self.target))


WINDOWS = {
    "window": Window((-9.0, 6.4, 7.0), (0.5, 1.15, -1.2), (2, 3), (0.72, 0.62), 0.09, 4.5),
    "fog": Window((-5.6, 10.5, -8.2), (0.0, 0.9, 0.0), (1, 1), (0.4, 0.46), 0.15, 0.9, 0.75, True),
}
"""The windows of stages, by kind."""

_STEPS = ((0.0, 0.0, 0.0), (-1.95, -0.62, 0.35), (1.9, 0.66, -0.75), (2.75, -1.05, 0.75), (-2.3, 0.95, -2.1))
"""Plinths of a stair: x, the height of the top in widths of 1.7, and z; the subject's own first."""

_SHELF_DEPTH, _BOARD_THICKNESS, _TABLE_THICKNESS = 1.25, 0.13, 0.16
"""Half the depth of shelves, stage units, and the thickness of boards and table tops."""


def room_backdrop(kind: str, height: float) -> Mesh:
    """Return floor and walls of a room. height: of the walls of a corner"""
    x, z = _CORNER
    if kind == "corner":
        left, right = ((x + _FAR * a, z + _FAR * b) for a, b in (_LEFT, _RIGHT))
        front = (left[0] + right[0] - x, left[1] + right[1] - z)
        floor = _sheet(_at(left), _at(front), _at((x, z)), _at(right))
        return joined([floor, _wall(left, (x, z), height), _wall((x, z), right, height)])
    ends = (-_FAR, _WALL), (_FAR, _WALL)
    if kind == "window":
        floor = _sheet(_at((-_FAR, _FAR)), _at((_FAR, _FAR)), _at(ends[0]), _at(ends[1]))
        return joined([floor, _wall(*ends)])
    back = -_SHELF_DEPTH
    return _sheet((-_FAR, -HIGH, back), (_FAR, -HIGH, back), (-_FAR, HIGH, back), (_FAR, HIGH, back))


@lru_cache(maxsize=4)
def props(kind: str, width: float, height: float, is_round: bool) -> Mesh | None:
    """Return what stands in a place and the subject on: plinths, boards, a table top; None for nothing."""
    if kind == "stair":
        floor, unit = -height, width / 1.7
        tops = [(x * unit, max(y * unit, 0.2 + floor), z * unit) for x, y, z in _STEPS]
        return joined([_moved(_pillar(width / 2.0, y - floor, 1.6 * BEVEL), (x, y, z)) for x, y, z in tops])
    if kind == "table":
        half = width / 2.0
        return _refined(_pillar(half, _TABLE_THICKNESS, half if is_round else 1.6 * BEVEL))
    if kind == "shelf":
        rows = [k * height for k in range(-3, 4)]
        board = _refined(_pillar(_SHELF_DEPTH, _BOARD_THICKNESS, 1.6 * BEVEL, _FAR))
        tall = 7.0 * height
        upright = _pillar(_SHELF_DEPTH, tall, 1.6 * BEVEL, 0.5 * _BOARD_THICKNESS)
        columns = [(k + 0.5) * width for k in range(-3, 3)]
        boards = [_moved(board, (0.0, y, 0.0)) for y in rows]
        return joined([*boards, *(_moved(upright, (x, 3.5 * height, -0.02)) for x in columns)])
    return (
        _pillar(width / 2.0, height, width / 2.0 if is_round else 1.6 * BEVEL) if kind == "plinth" else None
    )


def shelf_opening(points: NDArray[np.float64], width: float, height: float) -> NDArray[np.float64]:
    """Return the share of light from the front that boards and uprights let through to a shelf's wall (N,).

    It is the form factor of the opening of a compartment, by those of four rectangles that meet before the
    point; NaN for points (N, 3) that are not of the wall.
    """
    x = np.abs(points[:, 0] - width * np.round(points[:, 0] / width))
    y = points[:, 1] % height
    half = 0.5 * (width - _BOARD_THICKNESS)
    seen = np.zeros(len(points))
    for across in (half - x, half + x):
        for up in (y, height - _BOARD_THICKNESS - y):
            a, b = (np.maximum(side, 0.0) / (2.0 * _SHELF_DEPTH) for side in (across, up))
            far_a, far_b = np.hypot(1.0, a), np.hypot(1.0, b)
            seen += (a / far_a * np.arctan(b / far_a) + b / far_b * np.arctan(a / far_b)) / (2.0 * math.pi)
    return np.where(np.abs(points[:, 2] + _SHELF_DEPTH) < 1e-3, seen, np.nan)


def window_frame(window: Window) -> Mesh:
    """Return the wall with a window: light falls through its panes."""
    light, target = np.array(window.light), np.array(window.target)
    middle = target + window.share * (light - target)
    facing = (light - target) / np.linalg.norm(light - target)
    right = np.cross((0.0, 1.0, 0.0), facing)
    right /= np.linalg.norm(right)
    up = np.cross(facing, right)
    xs, ys = (_edges(count, size, window) for count, size in zip(window.panes, window.pane, strict=True))
    parts = []
    for i in range(len(xs) - 1):
        for j in range(len(ys) - 1):
            if not (i % 2 and j % 2):  # a pane
                places = [(xs[i + a], ys[j + b]) for b in (0, 1) for a in (0, 1)]
                low_left, low_right, high_left, high_right = (middle + x * right + y * up for x, y in places)
                parts.append(_quad(low_left, low_right, high_left, high_right))
    if window.has_hood:
        parts += _hood(middle, 0.98 * (light - middle), window.board * right, window.board * up)
    return joined(parts)


def _hood(middle: Floats, back: Floats, right: Floats, up: Floats) -> list[Mesh]:
    """Return four walls from the edges of a board backwards. Those behind the light itself would be seen as
    crossing its plane, and throw no shadow in previews."""
    corners = [middle + x * right + y * up for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    return [_quad(start, end, start + back, end + back) for start, end in pairs]


def _edges(count: int, size: float, window: Window) -> list[float]:
    """Return the edges of panes and bars along one side of the window, and the ends of the wall around it."""
    whole = count * size + (count - 1) * window.bar
    inner = [-0.5 * whole + k * (size + window.bar) + side for k in range(count) for side in (0.0, size)]
    return [-window.board, *inner, window.board]


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Return meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts[:-1])])
    faces = [part[2] + np.int32(start) for part, start in zip(parts, starts, strict=True)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]), np.concatenate(faces)


def _at(place: tuple[float, float], height: float = 0.0) -> Triple:
    return place[0], height, place[1]


def _wall(start: tuple[float, float], end: tuple[float, float], height: float = HIGH) -> Mesh:
    """Return a wall over a line of the plan, seen from its right as one goes from start to end."""
    return _sheet(_at(start), _at(end), _at(start, height), _at(end, height))


def _quad(low_left: NDArray[np.float64], low_right: NDArray[np.float64], *upper: NDArray[np.float64]) -> Mesh:
    corners = np.array([low_left, low_right, *upper])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
    return corners.astype(np.float32), normals.astype(np.float32), np.array([[0, 1, 3], [0, 3, 2]], np.int32)


def _sheet(low_left: Triple, low_right: Triple, high_left: Triple, high_right: Triple) -> Mesh:
    """Return a flat grid between four corners, whose front sees them in this order."""
    a, b, c, d = (np.array(corner) for corner in (low_left, low_right, high_left, high_right))
    columns = max(2, math.ceil(float(np.linalg.norm(b - a)) / _GRID))
    rows = max(2, math.ceil(float(np.linalg.norm(c - a)) / _GRID))
    u, v = np.linspace(0.0, 1.0, columns + 1)[None, :, None], np.linspace(0.0, 1.0, rows + 1)[:, None, None]
    points = ((1.0 - u) * (1.0 - v) * a + u * (1.0 - v) * b + (1.0 - u) * v * c + u * v * d).reshape(-1, 3)
    normal = np.cross(b - a, c - a)
    i, j = np.arange(rows)[:, None] * (columns + 1), np.arange(columns)[None, :]
    first = (i + j).reshape(-1, 1)
    faces = np.concatenate(
        [first + np.array([0, 1, columns + 2]), first + np.array([0, columns + 2, columns + 1])]
    )
    normals = np.tile(normal / np.linalg.norm(normal), (len(points), 1))
    return points.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32)


def _refined(mesh: Mesh) -> Mesh:
    """Return a mesh with its longest edges halved until none is longer than _GRID."""
    vertices, normals, faces = mesh
    while True:
        corners = vertices[faces]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        longest, is_long = lengths.argmax(axis=1), lengths.max(axis=1) > _GRID
        if not is_long.any():
            return vertices, normals, faces
        order = (longest[is_long, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[is_long], order, axis=1).T
        middle = len(vertices) + np.arange(len(a), dtype=np.int32)
        turned = normals[a] + normals[b]
        vertices = np.concatenate([vertices, 0.5 * (vertices[a] + vertices[b])])
        normals = np.concatenate([normals, turned / np.linalg.norm(turned, axis=1, keepdims=True)])
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        faces = np.concatenate([faces[~is_long], *halves]).astype(np.int32)


def _moved(mesh: Mesh, by: Triple) -> Mesh:
    return mesh[0] + np.array(by, np.float32), mesh[1], mesh[2]


def _pillar(half: float, height: float, corner: float, half_across: float | None = None) -> Mesh:
    """Return a pillar with a square section of half-width `half`, its vertical edges rounded by `corner`.

    half_across  half its width along x, where that is another

    It is round where `corner` is `half`. The section shrinks towards the top by its corners alone: straight
    parts keep their length.
    """
    turned = corner == half
    part = np.linspace(0.0, 1.0, 24 if turned else 6, endpoint=not turned)
    angle = (np.arange(4)[:, None] + part[None, :]) * math.pi / 2.0
    out = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 2)
    middle = (np.arange(4) + 0.5) * math.pi / 2.0
    sides_of = np.sign(np.stack([np.cos(middle), np.sin(middle)], axis=1))
    halves = np.array([half if half_across is None else half_across, half])
    centre = (halves - corner) * np.repeat(sides_of, len(part), axis=0)
    lean = np.linspace(math.pi / 2.0, 0.0, 7)
    inset = np.append(BEVEL * (1.0 - np.cos(lean)), 0.0)
    level = np.append(BEVEL * (np.sin(lean) - 1.0), -height)
    tilt = np.append(lean, 0.0)
    rings, sides = len(inset), len(out)
    vertices, normals = np.empty((rings, sides, 3)), np.empty((rings, sides, 3))
    vertices[..., [0, 2]] = centre + (corner - inset)[:, None, None] * out
    vertices[..., 1] = level[:, None]
    normals[..., [0, 2]] = np.cos(tilt)[:, None, None] * out
    normals[..., 1] = np.sin(tilt)[:, None]
    i, j = np.arange(rings - 1)[:, None] * sides, np.arange(sides)[None, :]
    k = (j + 1) % sides
    above, after, below, across = i + j, i + k, i + sides + j, i + sides + k
    wall = [np.stack([above, after, across], -1), np.stack([above, across, below], -1)]
    lid = np.stack([np.full(sides, rings * sides), k[0], j[0]], axis=-1)
    faces = np.concatenate([*(part.reshape(-1, 3) for part in wall), lid]).astype(np.int32)
    top = np.array([[0.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    return (
        np.concatenate([vertices.reshape(-1, 3), top[0]]).astype(np.float32),
        np.concatenate([normals.reshape(-1, 3), top[1]]).astype(np.float32),
        faces,
    )
