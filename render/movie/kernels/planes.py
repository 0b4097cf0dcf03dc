"""Kernel that converts RGB to BT.709 Y′CbCr."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Array = NDArray[Any]

RED, GREEN, BLUE = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
"""Weights of luma (ITU-R BT.709-6, 3.2)."""

CB, CR = np.float32(224 / 1.8556), np.float32(224 / 1.5748)
"""Steps of 8 bits per difference of blue, and of red, from luma (ITU-R BT.709-6, 3.3 and 3.4)."""


@compiled()
def to_ycbcr(frame: Array, white: np.float32, scale: np.float32, dither: Array, planes: Array) -> None:
    """Convert full-range RGB (H, W, 3 or 4) to limited-range Y, Cb, Cr, in planes (3, H, W).

    white   the frame's value of white
    scale   steps per step of 8 bits
    dither  (H, W): a value is rounded up where its fraction is 1 - dither or more
    """
    black, middle, luma_range = np.float32(16.0), np.float32(128.0), np.float32(219.0)
    for i in range(frame.shape[0]):
        for j in range(frame.shape[1]):
            red, green, blue = (
                np.float32(frame[i, j, 0]) / white,
                np.float32(frame[i, j, 1]) / white,
                np.float32(frame[i, j, 2]) / white,
            )
            luma = red * RED + green * GREEN + blue * BLUE
            offset = dither[i, j]
            planes[0, i, j] = np.int32((black + luma_range * luma) * scale + offset)
            planes[1, i, j] = np.int32((middle + CB * (blue - luma)) * scale + offset)
            planes[2, i, j] = np.int32((middle + CR * (red - luma)) * scale + offset)
