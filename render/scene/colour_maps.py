"""Colour maps for numbers: widely known perceptual ones, from matplotlib.

viridis, plasma, inferno, magma (N. Smith and S. van der Walt, 2015) and cividis (J. Nuñez et al., PLOS ONE
13(7), 2018) grow lighter as the number grows, by equal perceived steps; turbo (A. Mikhailov, 2019) is a
rainbow made smooth; coolwarm (K. Moreland, *Diverging Color Maps for Scientific Visualization*, 2009) is
for numbers on both sides of a middle.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

COLOUR_MAPS = ("viridis", "plasma", "inferno", "magma", "cividis", "turbo", "coolwarm")

TEXELS = 256
"""Colours in a map."""


@cache
def colour_map(name: str) -> NDArray[np.float32]:
    """Return linear Rec.709 reflectances (TEXELS, 3), from the lowest number to the highest."""
    from matplotlib import colormaps

    srgb = np.asarray(colormaps[name](np.linspace(0.0, 1.0, TEXELS)))[:, :3]
    linear = linear_of_srgb(srgb).astype(np.float32)
    linear.setflags(write=False)
    return linear


def linear_of_srgb(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the linear values of sRGB values 0 … 1 (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
