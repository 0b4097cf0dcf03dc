"""Shadows of quick previews: those of the key light, and contact shadows under a subject close to the floor.

The key light is the first softbox, or where there is none the first sun; it has a shadow map. For contact
shadows a grid on the floor holds how low the subject is over each cell. A cell above takes from a point of
the floor the light that a level square of its size takes (the form factor of two parallel patches).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.raster.raster_shapes import (
    EDGE,
    Array,
    Floats,
    ScreenProjection,
    Shape,
    StageSetup,
    box,
    corner,
    exact,
    fast,
    shading_props,
    shadow_opacity,
)
from flowsculpt.render.scene.render_camera import Camera, unit
from flowsculpt.render.scene.room_shapes import ROOMS
from flowsculpt.render.scene.scene_lights import Softbox
from flowsculpt.render.scene.scene_stage import StagePlacement

CELLS, REACH = 48, 2.4  # cells along each side of the grid, and half of its side, stage units

LOOKS_DARK, PACKED_DARK = 0.55, 0.3
"""Exponents by which display values and packed values of a floor fall with the light that reaches it."""

CELL = 2.0 * REACH / CELLS  # side of a cell, stage units
_HIGH = 1.5  # height from which on a subject casts no contact shadow, stage units
_LEAST_HEIGHT = 1.4 * CELL  # height of a subject on the floor, stage units: a lower one would show the cells
_DARKEST = 0.1  # least fraction of light that reaches the floor: the subject reflects it
_OVERLAP = 1.8  # rate at which light falls with the sum of what cells take: of those in line one takes it


class ContactShadow(NamedTuple):
    """The contact shadow on a floor.

    frame  (6,): origin (3) and size of the stage, cosine and sine of its turn
    open   (CELLS, CELLS), the fraction of light from above that reaches the middle of each cell; empty
           without a floor
    """

    frame: NDArray[np.float64]
    open: NDArray[np.float32]

    @classmethod
    def of(
        cls, vertices: NDArray[np.float32], placement: StagePlacement, has_floor: bool, opacity: float = 1.0
    ) -> ContactShadow:
        """Return the contact shadow of a subject's vertices (V, 3). opacity: of the subject"""
        turn = np.cos(placement.turn), np.sin(placement.turn)
        frame = np.array([*placement.origin, placement.size, *turn])
        if not has_floor:
            return cls(frame, np.zeros((0, 0), np.float32))
        lowest = np.full((CELLS, CELLS), np.inf, np.float32)
        lowest_points(vertices, frame, lowest)
        reached = np.empty((CELLS, CELLS), np.float32)
        unblocked(lowest, opacity, reached)
        return cls(frame, reached)

    def factors(self, exponent: float) -> NDArray[np.float32]:
        """Return the factors (CELLS, CELLS) on values of the floor. exponent: LOOKS_DARK or PACKED_DARK"""
        return np.asarray(self.open**exponent, np.float32)

    def coordinates(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the place (N, 2) of points on the grid, in cells; far outside for points off the floor."""
        x, y, z = (points - self.frame[:3]).T / self.frame[3]
        cosine, sine = self.frame[4:]
        places = np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=1)
        places[np.abs(y) > 0.05] = 1e3
        return ((places + REACH) / CELL - 0.5).astype(np.float32)


@fast
def lowest_points(vertices: Array, frame: Array, lowest: Array) -> None:
    """Write the height of the lowest vertex over each cell into lowest (CELLS, CELLS), stage units."""
    scale = 1.0 / frame[3]
    for v in range(vertices.shape[0]):
        x, z = (vertices[v, 0] - frame[0]) * scale, (vertices[v, 2] - frame[2]) * scale
        x, z = frame[4] * x - frame[5] * z, frame[5] * x + frame[4] * z
        i, j = int((x + REACH) / CELL), int((z + REACH) / CELL)
        if x > -REACH and z > -REACH and i < CELLS and j < CELLS:
            height = np.float32((vertices[v, 1] - frame[1]) * scale)
            if height < lowest[i, j]:
                lowest[i, j] = height


@fast
def unblocked(lowest: Array, opacity: float, reached: Array) -> None:
    """Write the fraction of light that reaches each cell of the floor into reached (CELLS, CELLS)."""
    area = np.float32(CELL * CELL)
    reached[:] = 1.0
    for i in range(CELLS):
        for j in range(CELLS):
            if not lowest[i, j] < _HIGH:
                continue
            height = max(lowest[i, j], np.float32(_LEAST_HEIGHT))
            squared = height * height
            around = int(4.0 * height / CELL) + 1
            taken = np.float32(opacity * area * squared / np.pi)
            for m in range(max(0, i - around), min(CELLS, i + around + 1)):
                level = squared + area * (m - i) * (m - i)
                for n in range(max(0, j - around), min(CELLS, j + around + 1)):
                    distance = level + area * (n - j) * (n - j)
                    reached[m, n] -= taken / (distance * distance)
    for i in range(CELLS):
        for j in range(CELLS):
            taken = 1.0 - reached[i, j]
            reached[i, j] = _DARKEST + (1.0 - _DARKEST) * math.exp(-_OVERLAP * taken)


@fast
def open_at(reached: Array, row: float, column: float) -> float:
    """Return the fraction of light from above at a place on the grid, in cells; 1 outside of it."""
    if not (0.0 <= row < CELLS - 1.0 and 0.0 <= column < CELLS - 1.0) or reached.shape[0] == 0:
        return 1.0
    i, j = int(row), int(column)
    down, right = row - i, column - j
    near = reached[i, j] + right * (reached[i, j + 1] - reached[i, j])
    far = reached[i + 1, j] + right * (reached[i + 1, j + 1] - reached[i + 1, j])
    return float(near + down * (far - near))


@fast
def dim_floor(places: Array, factors: Array, factor: Array) -> None:
    """Write the factor on values at places (2, N) of the floor into factor (N,).

    factors  (CELLS, CELLS), of each cell, as `ContactShadow.factors` returns them
    """
    for n in range(places.shape[1]):
        row, column = places[0, n], places[1, n]
        inside = row >= 0.0 and column >= 0.0 and row < CELLS - 1.0 and column < CELLS - 1.0
        factor[n] = open_at(factors, row, column) if inside else 1.0


BLOCK = 8  # pixels along a block of the shadow map that is tested at once

_RADIUS = 5
_COARSE = (-4, 0, 4)
"""Offsets of the pixels that are asked first; where they differ, half of those within _RADIUS are."""


@exact
def render_depth(screen: Array, faces: Array, side: int, nearness: Array) -> None:
    """Write one over the depth of the nearest triangle into nearness (2, S, S), which is 0 at first.

    side  0 if both sides may be visible. For a closed surface 1 or -1, as triangles that face the light run
          counter-clockwise or clockwise: these go into nearness[0], others into nearness[1]

    Triangles that cross the plane of the light cast no shadow.
    """
    rows, columns = nearness.shape[1], nearness.shape[2]
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        if area == 0.0:
            continue
        layer = 1 if area * side < 0.0 else 0
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if left > right or top > bottom:
            continue
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        if not (depth_a > 0.0 and depth_b > 0.0 and depth_c > 0.0):
            continue
        ux, uy = (by - cy) / -area, (cx - bx) / -area
        vx, vy = (cy - ay) / -area, (ax - cx) / -area
        for i in range(top, bottom + 1):
            u = ux * (left - cx) + uy * (i - cy)
            v = vx * (left - cx) + vy * (i - cy)
            for j in range(left, right + 1):
                w = 1.0 - u - v
                if u >= -EDGE and v >= -EDGE and w >= -EDGE:
                    value = u * depth_a + v * depth_b + w * depth_c
                    if value > nearness[layer, i, j]:
                        nearness[layer, i, j] = value
                u += ux
                v += vx


@exact
def move_halfway(nearness: Array) -> None:
    """Move the depth of a closed surface halfway to its far side, in the output of `render_depth`.

    Lit points are then clear of their own shadow at every angle (Woo 1992).
    """
    for i in range(nearness.shape[1]):
        for j in range(nearness.shape[2]):
            if nearness[1, i, j] > 0.0:
                nearness[0, i, j] = 0.5 * (nearness[0, i, j] + nearness[1, i, j])


@exact
def block_maxima(nearness: Array, blocks: Array) -> None:
    """Write the maximum of each block of nearness and its neighbours into blocks (S / BLOCK, S / BLOCK)."""
    count = blocks.shape[0]
    maxima = np.zeros((count, count), np.float32)
    for i in range(nearness.shape[0]):
        for column in range(count):
            largest = np.float32(0.0)
            for j in range(BLOCK):
                largest = max(largest, nearness[i, BLOCK * column + j])
            maxima[i // BLOCK, column] = max(maxima[i // BLOCK, column], largest)
    for i in range(count):
        for j in range(count):
            blocks[i, j] = maxima[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2].max()


@exact
def light_coordinates(
    vertices: Array, normals: Array, which: Array, lift: float, origin: Array, axes: Array, out: Array
) -> None:
    """Write the coordinates of some vertices, moved by `lift` along their normals, into out (3, N).

    which  (N,), their indices; coordinates as of `projection.corner`
    """
    for n in range(which.shape[0]):
        v = which[n]
        x = vertices[v, 0] + lift * normals[v, 0] - origin[0]
        y = vertices[v, 1] + lift * normals[v, 1] - origin[1]
        z = vertices[v, 2] + lift * normals[v, 2] - origin[2]
        out[0, n], out[1, n], out[2, n] = corner(x, y, z, axes)


@fast
def light_visibility(
    coordinates: Array, nearness: Array, blocks: Array, opacity: float, fraction: Array
) -> None:
    """Write the visible fraction of the key light, 0 to 1, at N of coordinates (3, M) into fraction (N,).

    nearness  (S, S), one over the depth that the light reaches; empty if there is no key light
    blocks    (S / BLOCK, S / BLOCK), as `block_maxima` computes them
    opacity   the fraction of the light that a shadow lacks
    """
    side = nearness.shape[0]
    for n in range(fraction.shape[0]):
        fraction[n] = 1.0
        if side == 0 or coordinates[2, n] <= 0.0:
            continue
        value = 1.0 / coordinates[2, n]
        down = (1.0 - coordinates[1, n] * value) / 2.0 * side
        across = (coordinates[0, n] * value + 1.0) / 2.0 * side
        row, column = int(down), int(across)
        if not (_RADIUS <= row < side - _RADIUS and _RADIUS <= column < side - _RADIUS):
            continue
        if blocks[row // BLOCK, column // BLOCK] <= value:
            continue
        passed = 0
        for di in _COARSE:
            for dj in _COARSE:
                passed += nearness[row + di, column + dj] <= value
        if passed == 0 or passed == 9:  # only the thinnest shadows differ between
            fraction[n] = 1.0 - opacity * (1.0 - passed / 9.0)
            continue
        # Every second pixel, as on a chessboard: on slanted borders, whole rows or columns would give steps.
        # Each counts less the further it is.
        left = int(across - 4.5)
        whole = light = 0.0
        for j in range(left, left + 10):
            odd = j & 1
            top = 2 * int(0.5 * (down - odd) - 1.75) + odd
            for i in range(top, top + 10, 2):
                y, x = (i + 0.5 - down) / _RADIUS, (j + 0.5 - across) / _RADIUS
                weight = (1.0 - y * y) * (1.0 - x * x)
                whole += weight
                if nearness[i, j] <= value:
                    light += weight
        fraction[n] = 1.0 - opacity * (1.0 - light / whole)


ROOM_REACH = 4.2  # of places with walls or further plinths, on which shadows show
SHADOW_REACH = 2.6  # half the width of the shadow map, stage units at the subject
SUN_DISTANCE = 60.0  # distance from which the sun's shadow map is rendered, stage units
SHADOW_SIDE = 64 * BLOCK  # pixels along each side of the shadow map
SHADOW_LIFT = 0.06  # stage units above a surface at which its shadow is looked up: it does not shade itself


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """A shadow map. Without a key light there is no projection, and arrays are empty.

    nearness  (SHADOW_SIDE, SHADOW_SIDE), one over the depth, 0 for no surface
    blocks    (SHADOW_SIDE / BLOCK, SHADOW_SIDE / BLOCK), as the kernel `block_maxima` computes them
    lift      SHADOW_LIFT in scene units
    opacity   the fraction of the key light that the shadow lacks
    """

    projection: ScreenProjection | None
    nearness: NDArray[np.float32]
    blocks: NDArray[np.float32]
    lift: float
    opacity: float

    @classmethod
    def of(cls, subject: Shape, setup: StageSetup, side: int) -> ShadowMap:
        """Render a shadow map. side: as in the kernel `render_depth`"""
        opacity = shadow_opacity(subject.material)
        camera, lift = _key_camera(setup), SHADOW_LIFT * setup.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), lift, 1.0)
        projection, square = ScreenProjection.of(camera, 1.0), (SHADOW_SIDE, SHADOW_SIDE)
        layers = np.zeros((2, *square), np.float32)
        blocks = np.empty((SHADOW_SIDE // BLOCK,) * 2, np.float32)
        render_depth(projection.project(subject.vertices, *square), subject.faces, side, layers)
        if side:
            move_halfway(layers)
        if (props := shading_props(setup.stage, setup.placement)) is not None:
            render_depth(projection.project(props.vertices, *square), props.faces, 0, layers)
        block_maxima(layers[0], blocks)
        return cls(projection, layers[0], blocks, lift, opacity)

    def coordinates(self, shape: Shape, which: NDArray[np.intp], outwards: int) -> NDArray[np.float32]:
        """Return coordinates (3, N) of vertices in the map. outwards: as in `VisibleFaces`"""
        result = np.zeros((3, len(which)), np.float32)
        lift = -self.lift if outwards < 0 else self.lift
        if self.projection is not None:
            origin, axes = self.projection.origin, self.projection.axes
            light_coordinates(shape.vertices, shape.normals, which, lift, origin, axes, result)
        return result

    def visibility(self, coordinates: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the visible fraction (N,) of the key light at coordinates (3, N)."""
        fraction = np.empty(coordinates.shape[1], np.float32)
        light_visibility(coordinates, self.nearness, self.blocks, self.opacity, fraction)
        return fraction


def _key_camera(setup: StageSetup) -> Camera | None:
    """Return a camera at the key light, for a square shadow map, or None where there is no light."""
    rig, size = setup.lights, setup.placement.size
    if rig.softboxes:
        position, target = placed_softbox(rig.softboxes[0], setup)
    elif rig.suns:
        target = np.add(setup.placement.origin, (0.0, size, 0.0))
        position = target - SUN_DISTANCE * size * unit(np.array(rig.suns[0].direction))
    else:
        return None
    distance = float(np.linalg.norm(target - position))
    x, y, z = position.tolist()
    a, b, c = target.tolist()
    up = (0.0, 1.0, 0.0) if np.hypot(a - x, c - z) > 1e-3 * distance else (0.0, 0.0, 1.0)
    reach = ROOM_REACH if setup.stage.kind in (*ROOMS, "stair") else SHADOW_REACH
    angle = 2.0 * float(np.arctan(reach * size / distance))
    return Camera((x, y, z), (a, b, c), up, angle, near=1e-3 * distance, far=1e3 * distance)


def placed_softbox(box: Softbox, setup: StageSetup) -> tuple[Floats, Floats]:
    """Return the position of a softbox (3,) and its target (3,), scene units."""
    matrix = setup.placement.matrix()
    position, target = (matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (box.position, box.target))
    return position, target
