"""Colour maps for numbers: perceptual ones that are widely known, as matplotlib has them.

viridis, plasma, inferno, magma (N. Smith and S. van der Walt, 2015) and cividis (J. Nuñez et al., PLOS ONE
13(7), 2018) grow lighter as the number grows, by equal perceived steps; turbo (A. Mikhailov, 2019) is a
rainbow made smooth; coolwarm (K. Moreland, *Diverging Color Maps for Scientific Visualization*, 2009) is
for numbers that go both ways from a middle.
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
    """(TEXELS, 3): linear Rec.709 reflectances, from the lowest number to the highest."""
    from matplotlib import colormaps

    shown = np.asarray(colormaps[name](np.linspace(0.0, 1.0, TEXELS)))[:, :3]
    linear = linear_of_srgb(shown).astype(np.float32)
    linear.setflags(write=False)
    return linear


def linear_of_srgb(shown: NDArray[np.floating]) -> NDArray[np.float64]:
    """What sRGB values 0 … 1 stand for (IEC 61966-2-1)."""
    shown = np.asarray(shown, dtype=np.float64)
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
