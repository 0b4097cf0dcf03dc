"""What every picture that comes from outside must be before anything is made of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError


def require_finite(pixels: NDArray[np.floating], path: str) -> None:
    """Raises BadInputError, with the first of them, where pixels (H, W, C) are not numbers, or infinite."""
    bad = np.argwhere(~np.isfinite(pixels).all(axis=2))
    if len(bad):
        row, column = bad[0]
        raise BadInputError(
            f"{path}: pixel {column}, {row} and {len(bad) - 1} others are not finite; mend the file, with "
            "oiiotool --fixnan box3 for one"
        )
