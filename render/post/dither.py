"""The pattern that dithers rounding, so that slow gradients do not band."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


@lru_cache(maxsize=4)
def dither_pattern(height: int, width: int) -> NDArray[np.float32]:
    """Return thresholds (H, W), strictly between 0 and 1, evenly spread among neighbours.

    Interleaved gradient noise: J. Jimenez, Next Generation Post Processing in Call of Duty: Advanced
    Warfare, SIGGRAPH 2014. It is the same in every frame, so it does not shimmer.
    """
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    noise = 52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0) % 1.0
    pattern = np.asarray(np.clip(noise, 1e-3, 1.0 - 1e-3), dtype=np.float32)
    pattern.setflags(write=False)  # shared by all callers
    return pattern
