"""The noise of a frame, by which adaptive sampling stops.

After Dammertz, Hanika, Keller and Lensch, *A hierarchical automatic stopping condition for Monte Carlo global
illumination* (2010): the error is measured in blocks, over the square root of the light, which is about what
a display shows. They compare a picture with one of half its samples. Here all batches are compared with their
mean, so that the even spread of samples counts, which the variance of single samples does not show.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]

MIN_BATCHES = 2
"""Batches needed to compare."""

BLOCK = 16
"""Pixels along the side of a block."""

QUIET_FRACTION = 0.95
"""Fraction of the blocks that must be below the threshold, so that the noisiest corner does not decide."""

MIN_LUMINANCE = 0.01
"""Luminance below which noise counts as if the light were this bright."""


def noise_of(total: Picture, squares: Picture, count: int) -> float:
    """Return the noise of the mean of `count` batches, from the sums (H, W) of their luminance Y and of Y².

    The noise of a block of 16 × 16 pixels is √(mean s² / count / mean Y), where s² is a pixel's unbiased
    variance between batches; 19 of 20 blocks have at most the returned noise. A display shows about half of
    it: 0.02 there is a standard deviation of 2 to 3 steps of 255.
    """
    variance = np.maximum(squares - total * total / count, 0.0) / (count - 1)
    error = _block_means(variance) / count
    light = np.maximum(_block_means(total) / count, MIN_LUMINANCE)
    return float(np.quantile(np.sqrt(error / light), QUIET_FRACTION, method="inverted_cdf"))


def _block_means(picture: Picture) -> Picture:
    """Return the mean of each block; blocks at the right and lower edge may be smaller."""
    rows, columns = (np.arange(0, side, BLOCK) for side in picture.shape)
    sums = np.add.reduceat(np.add.reduceat(picture, rows, axis=0), columns, axis=1)
    heights, widths = (np.minimum(BLOCK, side - np.arange(0, side, BLOCK)) for side in picture.shape)
    return np.asarray(sums / (heights[:, None] * widths), dtype=np.float64)
