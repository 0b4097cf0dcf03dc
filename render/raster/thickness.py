"""Kernels: the thickness of a closed surface along the lines of sight, whatever the order of its faces.

Every face adds its depth where it turns away from the eye and takes it off where it turns to it. What is left
is the length of all parts of the line inside the surface.
"""

from __future__ import annotations

from render.raster.large_triangles import SUPERSAMPLING
from render.raster.projection import Array, exact

GRID = 256
"""Steps of corners within a pixel: on a grid, neighbours share no pixel and leave none out."""


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
