"""When a picture is quiet enough to be left: its noise, as the eye meets it, judged by how passes differ.

After Dammertz, Hanika, Keller and Lensch, *A hierarchical automatic stopping condition for Monte Carlo global
illumination* (2010): the error is taken in blocks and over the square root of the light, which is about what
a display shows. They compare a picture with one of half its samples; here all passes are compared, each
against their mean. So it counts how evenly samples lie, which the spread of single ones knows nothing of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]

FEWEST_PASSES = 2
"""Passes that must be there before they can be compared."""

BLOCK = 16
"""Pixels along the side of a block."""

QUIET_SHARE = 0.95
"""How much of the picture must be as quiet as asked for: its noisiest corner alone keeps nobody waiting."""

DARKEST = 0.01
"""Luminance below which noise counts as in light of this luminance."""


def noise_of(total: Picture, squares: Picture, count: int) -> float:
    """The noise of the mean of `count` passes, from the sums (H, W) of their luminance Y and of Y².

    Of each block of 16 × 16 pixels √(mean s² / count / mean Y), where s² is a pixel's unbiased variance from
    pass to pass; 19 blocks in 20 have no more than what is returned. A display shows about half of it:
    0.02 there is a standard deviation of 2 to 3 steps of 255.
    """
    variance = np.maximum(squares - total * total / count, 0.0) / (count - 1)
    error = _means(variance) / count
    light = np.maximum(_means(total) / count, DARKEST)
    return float(np.quantile(np.sqrt(error / light), QUIET_SHARE, method="inverted_cdf"))


def _means(picture: Picture) -> Picture:
    """Of each block; those at the right and lower edge may be smaller."""
    rows, columns = (np.arange(0, side, BLOCK) for side in picture.shape)
    sums = np.add.reduceat(np.add.reduceat(picture, rows, axis=0), columns, axis=1)
    heights, widths = (np.minimum(BLOCK, side - np.arange(0, side, BLOCK)) for side in picture.shape)
    return np.asarray(sums / (heights[:, None] * widths), dtype=np.float64)
