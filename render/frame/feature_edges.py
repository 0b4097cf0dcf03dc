"""Pixels at edges of the auxiliary features, which alone need many samples of them.

The features of the first surface differ between the samples of a pixel at outlines, creases and in textures.
Elsewhere they change evenly from pixel to pixel, and a few samples are exact. Noise, as of what a lens blurs
or a mirror shows, differs from pixel to pixel too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled

Feature = NDArray[np.float32]

LIMITS = {
    "matte": 1e-3,
    "albedo": 0.02,
    "normal": 0.1,
    "depth": 0.05,
    "denoise_albedo": 0.02,
    "denoise_normal": 0.1,
}
"""Second differences between pixels in a row or column beyond which a feature has an edge; for depth, those
of its logarithm."""

_NEAREST = np.float32(1e-6)
"""Depth of pixels in which nothing is seen."""


def at_edges(features: Mapping[str, Feature]) -> NDArray[np.bool_]:
    """Return True (H, W) for pixels with an edge of any feature (H, W, channels), and for their eight
    neighbours, whose samples may all have missed it."""
    found = np.zeros(next(iter(features.values())).shape[:2], dtype=bool)
    for name, limit in LIMITS.items():
        if name in features:
            feature = features[name]
            feature = np.log(np.maximum(feature, _NEAREST)) if name == "depth" else feature
            _mark_edges(feature, np.float32(limit), found)
    return found


def prepare() -> None:
    """Compile the kernel, so that the first frame need not wait for it."""
    at_edges({"matte": np.zeros((1, 1, 1), np.float32)})


@compiled()
def _mark_edges(feature: Feature, limit: np.float32, found: NDArray[np.bool_]) -> None:
    """Mark pixels with an edge of a feature, and their neighbours."""
    height, width, channels = feature.shape
    for y in range(height):
        for x in range(width):
            along_row = along_column = np.float32(0.0)
            for channel in range(channels):
                twice = feature[y, x, channel] * np.float32(2.0)
                if 0 < x < width - 1:
                    second = twice - feature[y, x - 1, channel] - feature[y, x + 1, channel]
                    along_row = max(along_row, abs(second))
                if 0 < y < height - 1:
                    second = twice - feature[y - 1, x, channel] - feature[y + 1, x, channel]
                    along_column = max(along_column, abs(second))
            if max(along_row, along_column) > limit:
                found[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] = True
