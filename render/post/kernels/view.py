"""Kernels that apply a view's table to a picture and round it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Floats = NDArray[np.float32]


@compiled()
def apply_lut(light: Floats, gain: float, toe: float, white: float, lut: Floats, shown: Floats) -> None:
    """Look up colours (N, 3), times `gain`, trilinearly in a table (S, S, S, 3); write to `shown` (N, 3).

    The table's axes run over log2(1 + x/toe) from 0 to `white`. Negative values and NaN count as black.
    """
    last = lut.shape[0] - 1
    steps = last / math.log2(1.0 + white / toe)
    low = np.zeros(3, np.int64)
    part = np.zeros(3)
    for i in range(light.shape[0]):
        for axis in range(3):
            x = light[i, axis] * gain
            x = min(x, white) if x > 0.0 else 0.0
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
                total += weight * lut[r + dr, g + dg, b + db, channel]
            shown[i, channel] = min(max(total, 0.0), 1.0)


@compiled()
def quantise_dithered(values: Floats, dither: Floats, top: np.float32, steps: NDArray[np.integer]) -> None:
    """Round values (H, W, C), 0 … 1, to steps 0 … `top`: up where the fraction is 1 - dither (H, W) or more.

    NaN counts as black.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                value = values[i, j, k] if values[i, j, k] > zero else zero
                value = (value if value < one else one) * top + dither[i, j]
                steps[i, j, k] = np.int32(value if value < top else top)
