"""The pixels in which a clear subject is visible: its normals there, and its thickness along lines of sight.

Every face adds its depth where it turns away from the eye and takes it off where it turns to it, whatever the
order of faces. What is left is the length of all parts of the line inside the surface.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.raster.large_triangles import SUPERSAMPLING, WHITE
from render.raster.raster_projection import Array, exact, fast
from render.raster.raster_shapes import ScreenProjection

GRID = 256
"""Steps of corners within a pixel: on a grid, neighbours share no pixel and leave none out."""


class VisiblePoints(NamedTuple):
    """The pixels in which a subject is visible.

    pixels    (N, 2), rows and columns
    coverage  (N,), the fraction of the pixel that the subject covers
    depth     (N,)
    points    (N, 3), scene units
    normals   (N, 3)
    """

    pixels: NDArray[np.int32]
    coverage: NDArray[np.float32]
    depth: NDArray[np.float32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        nearness: NDArray[np.float32],
        behind: NDArray[np.float32],
        packed: NDArray[np.uint32],
        projection: ScreenProjection,
    ) -> VisiblePoints:
        """Find them. nearness, behind: with the subject and without it; packed: its normals, from 0 to 1"""
        most = nearness.size // SUPERSAMPLING**2
        pixels, (coverage, depth) = np.empty((most, 2), np.int32), np.empty((2, most), np.float32)
        points, normals = np.empty((2, most, 3), np.float32)
        axes = projection.axes / np.sum(projection.axes**2, axis=1, keepdims=True)
        count = find_visible(
            nearness, behind, packed, projection.origin, axes, pixels, coverage, depth, points, normals
        )
        return cls(pixels[:count], coverage[:count], depth[:count], points[:count], normals[:count])


@fast
def pack_normals(normals: Array, sign: float, packed: Array) -> None:
    """Write unit normals (V, 3), times a sign, as values from 0 to 1 into packed (V, 3)."""
    for v in range(normals.shape[0]):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        scale = 0.5 * sign / math.sqrt(max(x * x + y * y + z * z, 1e-12))
        packed[v, 0], packed[v, 1], packed[v, 2] = 0.5 + scale * x, 0.5 + scale * y, 0.5 + scale * z


@exact
def find_visible(
    nearness: Array,
    behind: Array,
    packed: Array,
    origin: Array,
    axes: Array,
    pixels: Array,
    coverage: Array,
    depth: Array,
    points: Array,
    normals: Array,
) -> int:
    """Write the fields of `VisiblePoints`, and return their number.

    axes  (3, 3): half of what the lens sees at depth 1 to the right and upwards, and forward
    """
    rows, columns = nearness.shape[0] // SUPERSAMPLING, nearness.shape[1] // SUPERSAMPLING
    count = 0
    for i in range(rows):
        for j in range(columns):
            hits, near, x, y, z = 0, 0.0, 0.0, 0.0, 0.0
            for s in range(SUPERSAMPLING * SUPERSAMPLING):
                row, column = SUPERSAMPLING * i + s // SUPERSAMPLING, SUPERSAMPLING * j + s % SUPERSAMPLING
                if nearness[row, column] > behind[row, column]:
                    hits += 1
                    near += nearness[row, column]
                    value = packed[row, column]
                    x += value >> np.uint32(20)
                    y += value >> np.uint32(10) & np.uint32(1023)
                    z += value & np.uint32(1023)
            if hits == 0:
                continue
            pixels[count, 0], pixels[count, 1] = i, j
            coverage[count] = hits / (SUPERSAMPLING * SUPERSAMPLING)
            depth[count] = hits / near
            x, y, z = x / hits - WHITE / 2.0, y / hits - WHITE / 2.0, z / hits - WHITE / 2.0
            scale = 1.0 / math.sqrt(max(x * x + y * y + z * z, 1e-12))
            normals[count, 0], normals[count, 1], normals[count, 2] = x * scale, y * scale, z * scale
            right, up = (2 * j + 1) / columns - 1.0, 1.0 - (2 * i + 1) / rows
            for k in range(3):
                ray = right * axes[0, k] + up * axes[1, k] + axes[2, k]
                points[count, k] = origin[k] + depth[count] * ray
            count += 1
    return count


@exact
def add_thickness(faces: Array, screen: Array, outwards: int, thickness: Array, layers: Array) -> None:
    """Add the depth behind faces (F, 3) at the middle of pixels, into thickness (H, W).

    screen    (V, 3), as `project` computes them
    outwards  as in `VisibleFaces`, 1 or -1
    layers    (H, W, 2) int32: the faces that turn to the eye, and those that turn away

    Faces that cross the camera plane are left out.
    """
    rows, columns = thickness.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            continue
        ax, ay, bx, by = (
            _on_grid(screen, a, 0),
            _on_grid(screen, a, 1),
            _on_grid(screen, b, 0),
            _on_grid(screen, b, 1),
        )
        cx, cy = _on_grid(screen, c, 0), _on_grid(screen, c, 1)
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        if area == 0:
            continue
        side = 0 if (area > 0) == (outwards > 0) else 1
        if area < 0:  # the other way round, the edges have one sense of rotation
            b, c, bx, by, cx, cy, area = c, b, cx, cy, bx, by, -area
        left, right = max(0, -(-min(ax, bx, cx) // GRID)), min(columns - 1, max(ax, bx, cx) // GRID)
        top, bottom = max(0, -(-min(ay, by, cy) // GRID)), min(rows - 1, max(ay, by, cy) // GRID)
        sign = -1.0 if side == 0 else 1.0
        for i in range(top, bottom + 1):
            y = GRID * i
            for j in range(left, right + 1):
                x = GRID * j
                u = (cy - by) * (x - bx) - (cx - bx) * (y - by)
                v = (ay - cy) * (x - cx) - (ax - cx) * (y - cy)
                w = (by - ay) * (x - ax) - (bx - ax) * (y - ay)
                if (
                    (u > 0 or (u == 0 and _owns(cx - bx, cy - by)))
                    and (v > 0 or (v == 0 and _owns(ax - cx, ay - cy)))
                    and (w > 0 or (w == 0 and _owns(bx - ax, by - ay)))
                ):
                    nearness = (u * screen[a, 2] + v * screen[b, 2] + w * screen[c, 2]) / area
                    thickness[i, j] += sign / nearness
                    layers[i, j, side] += 1


@exact
def _on_grid(screen: Array, v: int, k: int) -> int:
    """Return a coordinate of a vertex on the grid, where multiples of GRID are the middles of pixels."""
    middle = 0.5 * (SUPERSAMPLING - 1)
    return round((float(screen[v, k]) - middle) / SUPERSAMPLING * GRID)


@exact
def _owns(dx: int, dy: int) -> bool:
    """Tell whether a point on an edge belongs to the triangle on this side of it; the other one says no."""
    return dy > 0 or (dy == 0 and dx > 0)
