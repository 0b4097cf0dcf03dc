"""Colours as luma and two differences, compiled: one pixel after another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Array = NDArray[Any]

RED, GREEN, BLUE = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
"""Of luma: ITU-R BT.709-6, 3.2."""

CB, CR = np.float32(224 / 1.8556), np.float32(224 / 1.5748)
"""Steps of eight bits over the difference of blue, and of red, from luma; 3.3 and 3.4 there."""


@compiled()
def to_ycbcr(frame: Array, top: np.float32, scale: np.float32, noise: Array, planes: Array) -> None:
    """Full-range RGB (H, W, 3 or 4) as limited-range Y, Cb, Cr, into planes (3, H, W).

    top    what white is in the frame; scale, how many steps come to one of eight bits
    noise  (H, W): steps are rounded up where the rest is 1 - noise or more
    """
    dark, middle, high = np.float32(16.0), np.float32(128.0), np.float32(219.0)
    for i in range(frame.shape[0]):
        for j in range(frame.shape[1]):
            red, green, blue = (
                np.float32(frame[i, j, 0]) / top,
                np.float32(frame[i, j, 1]) / top,
                np.float32(frame[i, j, 2]) / top,
            )
            luma = red * RED + green * GREEN + blue * BLUE
            grain = noise[i, j]
            planes[0, i, j] = np.int32((dark + high * luma) * scale + grain)
            planes[1, i, j] = np.int32((middle + CB * (blue - luma)) * scale + grain)
            planes[2, i, j] = np.int32((middle + CR * (red - luma)) * scale + grain)
