"""Pictures from files as Mitsuba's textures, lying where `render.mitsuba.texture_coordinates` has put them.

An engine must have been started before anything here is called.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.texture_coordinates import Marks
from render.scene.texture_projection import Projection


def bitmap(pixels: NDArray[np.floating], marks: Marks, projection: Projection) -> dict[str, Any]:
    """A texture of pixels (H, W, k), which are linear colours or data."""
    import mitsuba as mi

    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.array(pixels, dtype=np.float32, order="C")),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat",
        "to_uv": to_uv(marks, projection, pixels.shape[1] / pixels.shape[0]),
    }


def to_uv(marks: Marks, projection: Projection, aspect: float = 1.0) -> Any:
    """From texture coordinates to Mitsuba's in a picture, which go from its upper left corner right and down.

    aspect: width to height of the picture
    """
    import mitsuba as mi

    right, up = projection.offset
    higher = aspect if projection.keeps_shape else 1.0
    matrix = np.eye(3, dtype=np.float32)
    matrix[0, 2] = 0.5 - right
    matrix[1, 1:] = -higher * marks.factor, 0.5 + up - higher * marks.added
    return mi.ScalarTransform3f(matrix)
