"""Kernels: draw lines over a picture: edges of faces, and segments of streamlines."""

from __future__ import annotations

import numpy as np

from render.raster.kernels.decorators import Array, fast
from render.raster.kernels.large_triangles import SUPERSAMPLING


@fast
def draw_edges(screen: Array, faces: Array, face_ids: Array, ink: Array, picture: Array) -> None:
    """Draw the edges of visible faces (F, 3) over a picture (H, W, 3) of display values.

    screen    (V, 3), as `project` computes them; faces that cross the camera plane have no edges
    face_ids  (SUPERSAMPLING H, SUPERSAMPLING W): the visible face; ids beyond F have no edges
    ink       (5,): colour, opacity, and width in pixels
    """
    share = ink[3] / (SUPERSAMPLING * SUPERSAMPLING)
    for i in range(face_ids.shape[0]):
        for j in range(face_ids.shape[1]):
            f = face_ids[i, j]
            if not 0 <= f < faces.shape[0]:
                continue
            distance = np.inf
            for k in range(3):
                a, b = faces[f, k], faces[f, (k + 1) % 3]
                if min(screen[a, 2], screen[b, 2]) <= 0.0:
                    continue
                dx, dy = screen[b, 0] - screen[a, 0], screen[b, 1] - screen[a, 1]
                across = abs((j - screen[a, 0]) * dy - (i - screen[a, 1]) * dx)
                distance = min(distance, across / max(np.sqrt(dx * dx + dy * dy), 1e-12))
            cover = share * min(1.0, max(0.0, ink[4] / 2.0 + 0.5 - distance / SUPERSAMPLING))
            for k in range(3):
                picture[i // SUPERSAMPLING, j // SUPERSAMPLING, k] += cover * (
                    ink[k] - picture[i // SUPERSAMPLING, j // SUPERSAMPLING, k]
                )


@fast
def draw_lines(ends: Array, inks: Array, width: float, hidden: float, depth: Array, picture: Array) -> None:
    """Draw short segments over a picture (H, W, 3), in order, with soft edges.

    ends    (N, 2, 3): the ends of each segment, pixels from the left and the top, and depth
    inks    (N, 4): colour and opacity
    width   pixels
    hidden  factor on the opacity behind the surface, of depth (H, W)
    """
    rows, columns = depth.shape
    reach = width / 2.0 + 1.0
    for n in range(ends.shape[0]):
        x0, y0, z0 = ends[n, 0]
        x1, y1, z1 = ends[n, 1]
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        if squared < 1e-12 or min(z0, z1) <= 0.0:
            continue
        for i in range(max(0, int(min(y0, y1) - reach)), min(rows, int(max(y0, y1) + reach) + 1)):
            for j in range(max(0, int(min(x0, x1) - reach)), min(columns, int(max(x0, x1) + reach) + 1)):
                px, py = j + 0.5 - x0, i + 0.5 - y0
                along = (px * dx + py * dy) / squared
                if along < 0.0 or along >= 1.0:
                    continue  # the next segment draws it
                distance = abs(px * dy - py * dx) / np.sqrt(squared)
                cover = min(1.0, width / 2.0 + 0.5 - distance)
                if cover <= 0.0:
                    continue
                opacity = inks[n, 3] * cover
                if z0 + along * (z1 - z0) > depth[i, j]:
                    opacity *= hidden
                for k in range(3):
                    picture[i, j, k] += opacity * (inks[n, k] - picture[i, j, k])
