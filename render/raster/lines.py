"""Lines over a quick preview: streamlines that a surface hides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.lines import draw_lines
from render.raster.parts import Preview
from render.scene.camera import Camera

Floats = NDArray[np.float64]

HIDDEN = 0.1
"""What is left of a line's opacity behind the surface."""


def with_lines(
    shown: Preview, lines: Floats, colours: Floats, opacity: Floats, camera: Camera, width: float
) -> NDArray[np.float32]:
    """The picture with lines (N, K, 3) over it; colours (N, K, 3) and opacity (N, K) at their points.

    What is behind the surface shines through faintly. Far lines are drawn first.
    """
    depth = shown.depth
    height, columns = depth.shape
    seen = camera.project(lines.reshape(-1, 3), columns / height).reshape(lines.shape)
    seen[..., 0] = (seen[..., 0] + 1.0) / 2.0 * columns
    seen[..., 1] = (1.0 - seen[..., 1]) / 2.0 * height
    order = np.argsort(-seen[..., 2].mean(axis=1))
    seen, inks = seen[order], np.concatenate([colours, opacity[..., None]], axis=2)[order]
    ends = np.stack([seen[:, :-1], seen[:, 1:]], axis=2).reshape(-1, 2, 3)
    inked = ((inks[:, :-1] + inks[:, 1:]) / 2.0).reshape(-1, 4)
    picture = shown.picture.astype(np.float64)
    draw_lines(np.ascontiguousarray(ends), np.ascontiguousarray(inked), width, HIDDEN, depth, picture)
    return picture.astype(np.float32)
