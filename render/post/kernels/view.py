"""Looking colours up in a cube and rounding them, compiled: NumPy would walk the picture forty times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Floats = NDArray[np.float32]


@compiled()
def look_up(light: Floats, gain: float, toe: float, brightest: float, cube: Floats, shown: Floats) -> None:
    """Each of `light` (N, 3), times `gain`, trilinearly in `cube` (S, S, S, 3), into `shown` (N, 3).

    Axes run over log2(1 + x/toe) from 0 to `brightest`; what is negative or not a number counts as black.
    """
    last = cube.shape[0] - 1
    steps = last / math.log2(1.0 + brightest / toe)
    low = np.zeros(3, np.int64)
    part = np.zeros(3)
    for i in range(light.shape[0]):
        for axis in range(3):
            x = light[i, axis] * gain
            x = min(x, brightest) if x > 0.0 else 0.0
            place = math.log2(1.0 + x / toe) * steps
            low[axis] = min(int(place), last - 1)
            part[axis] = place - low[axis]
        r, g, b = low
        for channel in range(3):
            total = 0.0
            for corner in range(8):
                dr, dg, db = corner >> 2, corner >> 1 & 1, corner & 1
                weight = part[0] if dr else 1.0 - part[0]
                weight *= part[1] if dg else 1.0 - part[1]
                weight *= part[2] if db else 1.0 - part[2]
                total += weight * cube[r + dr, g + dg, b + db, channel]
            shown[i, channel] = min(max(total, 0.0), 1.0)


@compiled()
def round_by(values: Floats, noise: Floats, top: np.float32, steps: NDArray[np.integer]) -> None:
    """Each of `values` (H, W, C), 0 … 1, to steps from 0 to `top`: up where the rest is 1 - noise (H, W) or
    more. What is not a number counts as black.
    """
    none, whole = np.float32(0.0), np.float32(1.0)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                value = values[i, j, k] if values[i, j, k] > none else none
                value = (value if value < whole else whole) * top + noise[i, j]
                steps[i, j, k] = np.int32(value if value < top else top)
