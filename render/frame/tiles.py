"""Tiles of a picture, the blocks of pixels that adaptive sampling measures and stops one by one; and their
noise.

After Dammertz, Hanika, Keller and Lensch, *A hierarchical automatic stopping condition for Monte Carlo global
illumination* (2010): the error is measured in blocks, over the square root of the light, which is about what
a display shows. They compare a picture with one of half its samples. Here all rounds of samples are compared
with their mean, so that the even spread of samples counts, which single samples do not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.scene.render_quality import Quality

TILE = 8
"""Pixels along the side of a tile. Smaller ones follow outlines more closely, where most noise is left after
denoising; larger ones measure noise better."""

MIN_LUMINANCE = 0.01
"""Luminance below which noise counts as if the light were this bright: displays show it as black."""

Picture = NDArray[np.float64]
PixelNumbers = NDArray[np.int64]
"""Numbers of pixels of the rendered part, row by row from its upper left."""

TileMask = NDArray[np.bool_]
"""A choice of tiles (rows, columns)."""


@dataclass(frozen=True, eq=False)
class Tiles:
    """The tiles of a rendered part.

    A crop has the tiles of the whole picture; those at its edges may be smaller.

    shape    rows and columns of tiles
    numbers  (pixels,): the tile of each pixel, counted row by row
    """

    shape: tuple[int, int]
    numbers: NDArray[np.int64]

    @cached_property
    def _order(self) -> PixelNumbers:
        """All pixels, tile by tile."""
        return np.argsort(self.numbers, kind="stable")

    @cached_property
    def _sizes(self) -> NDArray[np.int64]:
        """The pixels of each tile."""
        return np.bincount(self.numbers)

    @classmethod
    def of(cls, quality: Quality) -> Tiles:
        """Return the tiles of the part that a quality renders."""
        left, top = quality.crop[:2] if quality.crop else (0, 0)
        width, height = quality.rendered_size
        columns = np.arange(left, left + width) // TILE - left // TILE
        rows = np.arange(top, top + height) // TILE - top // TILE
        shape = int(rows[-1]) + 1, int(columns[-1]) + 1
        return cls(shape, (rows[:, None] * shape[1] + columns).ravel())

    def means(self, values: Picture) -> Picture:
        """Return the means (rows, columns) of pixel values (pixels,)."""
        sums = np.bincount(self.numbers, weights=values)
        return np.asarray(sums / self._sizes).reshape(self.shape)

    def pixels(self, chosen: TileMask | None) -> PixelNumbers:
        """Return the pixels of chosen tiles, tile by tile; None is all tiles.

        Rays of a tile meet the same things, so this order is traced in less time than rows of the picture.
        """
        return self._order if chosen is None else self.ordered(chosen.ravel()[self.numbers])

    def ordered(self, chosen: NDArray[np.bool_]) -> PixelNumbers:
        """Return chosen pixels (pixels,), tile by tile."""
        return self._order[chosen[self._order]]


def mean_with_neighbours(values: Picture) -> Picture:
    """Return means (rows, columns) of values and their eight neighbours; values repeat beyond the edges."""
    rows, columns = values.shape
    padded = np.pad(values, 1, mode="edge")
    shifted = [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
    return np.asarray(sum(shifted) / 9.0)


def noise_of_tiles(tiles: Tiles, luminance: Picture, variance: Picture, smooth: bool = False) -> Picture:
    """Return the noise (rows, columns) of tiles: about twice the standard deviation on a display of range 1.

    luminance  (pixels,): the mean Y of the samples
    variance   (pixels,): of that mean
    smooth     True takes the mean variance of a tile and its eight neighbours, which is measured better

    The noise is √(mean variance) over √(mean Y), and where Y is above 1, which displays compress, over Y.
    """
    light, spread = np.maximum(tiles.means(luminance), MIN_LUMINANCE), tiles.means(variance)
    spread = mean_with_neighbours(spread) if smooth else spread
    return np.asarray(np.sqrt(spread) / np.maximum(np.sqrt(light), light))
