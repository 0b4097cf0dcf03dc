"""Sums over the samples of each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled

_ALL_PIXELS = np.empty(0, np.int64)


@dataclass(frozen=True, eq=False)
class SampleSums:
    """Sums over the samples of each pixel.

    sums    (pixels, channels), of the type of what is added: light in float64, for its noise is a small
            difference of large sums, and features in float32
    counts  (pixels,): samples of each pixel in its sums
    """

    sums: NDArray[Any]
    counts: NDArray[np.int32]

    @classmethod
    def zeros(cls, pixels: int, channels: int, kind: Any = np.float64) -> SampleSums:
        """Return the sums of no samples, in a type."""
        return cls(np.zeros((pixels, channels), kind), np.zeros(pixels, dtype=np.int32))

    def add(self, means: NDArray[Any], samples: int, pixels: NDArray[np.int64] | None) -> None:
        """Add means (rows, channels) over `samples` samples to `pixels`, one row each;
        None is all pixels. Values that are not finite, as of a degenerate triangle, count as 0."""
        where = _ALL_PIXELS if pixels is None else pixels
        _add_samples(self.sums, self.counts, means, means.dtype.type(samples), where)

    def means(self, channels: slice = slice(None), kind: type = np.float64) -> NDArray[Any]:
        """Return the means (pixels, channels) of some channels, in a type; all pixels have had samples."""
        sums = self.sums[:, channels]
        means: NDArray[Any] = np.empty(sums.shape, kind)
        return np.divide(sums, self.counts[:, None], out=means, casting="same_kind")


def prepare() -> None:
    """Compile the kernel for light and features, so that the first frame need not wait for it."""
    light = np.zeros((2, 2))
    for rows in (light, light[:, :1], light.astype(np.float32)):
        SampleSums.zeros(2, rows.shape[1], rows.dtype).add(rows, 1, None)


@compiled()
def _add_samples(
    sums: NDArray[Any],
    counts: NDArray[np.int32],
    means: NDArray[Any],
    samples: Any,
    pixels: NDArray[np.int64],
) -> None:
    """Add means to sums, as of `SampleSums.add`; `pixels` is empty where the rows are all pixels."""
    for row in range(len(means)):
        pixel = pixels[row] if len(pixels) else row
        for channel in range(means.shape[1]):
            value = means[row, channel]
            if np.isfinite(value):
                sums[pixel, channel] += value * samples
        counts[pixel] += np.int32(samples)
