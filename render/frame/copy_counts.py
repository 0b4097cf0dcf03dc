"""Coverage of pixels by the copies of subjects: counts of samples, held only where a sample sees a copy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.aovs import COPIES, MOST_RANKS, Pixels

_NUMBERS = 1 << 20
"""More than the numbers of copies: a cell is the number of a pixel, times this, plus that of a copy."""

_NO_CELLS = np.empty(0, np.int64)


@dataclass
class CopyCounts:
    """Samples of each pixel that see each copy.

    cells   ascending, (C,): pixel and copy
    counts  (C,) of samples
    """

    cells: NDArray[np.int64] = field(default_factory=_NO_CELLS.copy)
    counts: NDArray[np.int64] = field(default_factory=_NO_CELLS.copy)

    def add(self, seen: NDArray[np.int32], pixels: NDArray[np.integer[Any]] | None = None) -> None:
        """Add the copies (pixels, samples) that samples see, 0 for none, of `pixels`; None is all pixels."""
        numbers = np.arange(len(seen)) if pixels is None else pixels
        rows, columns = np.nonzero(seen)
        latest = numbers[rows].astype(np.int64) * _NUMBERS + seen[rows, columns]
        cells, counts = np.unique(latest, return_counts=True)
        together, places = np.unique(np.concatenate([self.cells, cells]), return_inverse=True)
        weights = np.concatenate([self.counts, counts])
        self.cells, self.counts = together, np.bincount(places, weights, len(together)).astype(np.int64)

    def layers(self, samples: NDArray[np.integer[Any]]) -> dict[str, Pixels]:
        """Return layers (H, W, 4) of number and coverage of two copies each, the greatest coverage first.

        samples  (H, W) of each pixel

        Where nothing is left, the number is 0. Copies beyond MOST_RANKS are left out.
        """
        pixels, copies = np.divmod(self.cells, _NUMBERS)
        order = np.lexsort((copies, -self.counts, pixels))
        pixels, copies, counts = pixels[order], copies[order], self.counts[order]
        rank = np.arange(len(pixels)) - np.searchsorted(pixels, pixels)
        kept = rank < MOST_RANKS
        ranked = np.zeros((samples.size, MOST_RANKS, 2), np.float32)
        ranked[pixels[kept], rank[kept], 0] = copies[kept]
        ranked[pixels[kept], rank[kept], 1] = counts[kept] / samples.ravel()[pixels[kept]]
        planes = ranked.reshape(*samples.shape, MOST_RANKS // 2, 4)
        return {f"{COPIES}{index:02d}": planes[:, :, index] for index in range(MOST_RANKS // 2)}

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything, for a checkpoint."""
        return {"copies:cells": self.cells, "copies:counts": self.counts}

    @classmethod
    def restored(cls, state: Mapping[str, NDArray[Any]]) -> CopyCounts | None:
        """Return what `state` returned; None where there were none."""
        return cls(state["copies:cells"], state["copies:counts"]) if "copies:cells" in state else None
