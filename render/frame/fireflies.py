"""Find fireflies in the sums of all samples of a frame, and spread or remove their light.

A firefly is a pixel whose light comes from too few samples to be believed. Two numbers of each pixel tell,
sums of the luminance Y of its n samples and of Y²:

- ΣY² / ΣY is the brightness of the samples that carry the light;
- (ΣY)² / ΣY² is their number, the effective sample size (Kish 1965).

Samples of a like brightness in the 5 × 5 pixels around count too, so that caustics and glints of many rare
samples keep their light. Zirr, Hanika and Dachsbacher (*Re-weighting firefly samples for improved
finite-sample Monte Carlo estimates*, 2018) count them in pictures of ten brightness ranges; here the two
sums stand for these. The count grows with n, so with enough samples nothing is a firefly, and the picture
tends to the mean of its samples.

The filter is linear in radiance, so light groups that are filtered alike still sum to the beauty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]

BRIGHT_FACTOR = 3.0
"""Brightness of a pixel, over the third brightest of its eight neighbours, up to which it is no firefly."""

RELIABLE_COUNT = 8.0
"""Samples in the neighbourhood, of the brightness of a pixel's brightest, with which all its light is kept;
of 1, the pixel's own, only what is within BRIGHT_FACTOR."""

REACH = 2
"""Pixels to each side in the neighbourhood."""

BRIGHTENING = 0.02
"""Fraction by which the light of one firefly may brighten its surroundings: the brighter the firefly, the
farther its light is spread. Where all the picture is too small for it, the rest stays in its pixel. Spread,
one sample would make a film flicker; removed, the image of the sun in glass would never have its light."""

RADII = (2, 6, 20, 60, 180)
"""Radii in pixels of the kernels that spread light, up to an eighth of the picture."""

EVERYWHERE = 1 << 30
"""Radius of the kernel that gives all pixels the same ratio."""

_DARK = 1e-3
"""Luminance that counts as black."""


@dataclass(frozen=True, eq=False)
class FireflyFilter:
    """The light to take from fireflies, and where to put it.

    kept        fraction (H, W) of its light that each pixel keeps
    brightness  luminance (H, W) without fireflies. What is spread brightens pixels in reach by the same
                ratio, so that it shows least
    on_subject  True (H, W) where the subject covers most of a pixel. Its light stays on the subject, and the
                stage's on the stage
    spread      fraction (H, W) of its light that each pixel gives to others. What is neither kept nor spread
                is removed
    reached     brightness (H, W) that the kernel of a pixel's radius reaches
    radius      (H, W) of the kernel; 0 where no light is spread, EVERYWHERE where all pixels share it
    """

    kept: Picture
    brightness: Picture
    on_subject: NDArray[np.bool_]
    spread: Picture
    reached: Picture
    radius: NDArray[np.int32]

    def apply(self, light: Picture) -> Picture:
        """Return radiance (H, W, channels) with the light of fireflies spread or removed."""
        filtered = light * self.kept[..., None]
        for part in (self.on_subject, ~self.on_subject):
            radii = np.where(part, self.radius, 0)
            for radius in np.unique(radii[radii > 0]):
                weight = np.where(radii == radius, self.spread / self.reached, 0.0)
                for channel in range(light.shape[2]):
                    gain = _blurred(light[..., channel] * weight, int(radius))
                    filtered[..., channel] += part * self.brightness * gain
        return filtered

    def facts(self, luminance: Picture) -> dict[str, float]:
        """Return the fractions of the light, of luminance (H, W), that fireflies give to other pixels, that
        stay in them, being too bright to spread, and that are removed."""
        total = max(float(luminance.sum()), 1e-12)
        parts = {
            "light_spread": self.spread * luminance,
            "light_left": self.kept * luminance - self.brightness,
            "light_removed": (1.0 - self.kept - self.spread) * luminance,
        }
        return {name: _rounded(float(part.sum()) / total) for name, part in parts.items()}


def find_fireflies(
    luminance: Picture, square: Picture, samples: Picture, matte: Picture, treatment: str
) -> FireflyFilter:
    """Return the filter of a frame.

    luminance  (H, W), mean over the samples of each pixel
    square     (H, W), mean of the luminance's square
    samples    (H, W), their number
    matte      (H, W), coverage by the subject
    treatment  a Quality's `fireflies`: "keep" takes no light, "soft" spreads it, "firm" removes it
    """
    kept = kept_fractions(luminance, square, samples, treatment)
    nothing, reached = np.zeros_like(kept), np.ones_like(kept)
    radius = np.zeros(kept.shape, dtype=np.int32)
    removed = FireflyFilter(kept, luminance * kept, matte > 0.5, nothing, reached, radius)
    return _with_spread(removed, luminance) if treatment == "soft" else removed


def kept_fractions(luminance: Picture, square: Picture, samples: Picture, treatment: str) -> Picture:
    """Return the fraction (H, W) of its light that each pixel keeps; arguments as for `find_fireflies`."""
    kept = np.ones_like(luminance)
    if treatment != "keep":
        rows, columns, bound = _brighter_than_neighbours(luminance, square, samples)
        count = _supporting_samples(luminance, square, samples, rows, columns)
        reliability = np.clip((count - 1.0) / (RELIABLE_COUNT - 1.0), 0.0, 1.0)
        own = luminance[rows, columns]
        kept[rows, columns] = (bound + reliability * (own - bound)) / own
    return kept


def _brighter_than_neighbours(
    luminance: Picture, square: Picture, samples: Picture
) -> tuple[NDArray[np.intp], NDArray[np.intp], Picture]:
    """Return rows, columns and the bounds of pixels that are above them, of few samples by themselves."""
    rows, columns = np.nonzero(samples * luminance * luminance < RELIABLE_COUNT * square)
    padded = np.pad(luminance, 1, mode="edge")
    offsets = [(y, x) for y in range(3) for x in range(3) if (y, x) != (1, 1)]
    neighbours = np.stack([padded[rows + y, columns + x] for y, x in offsets])
    bound = BRIGHT_FACTOR * np.partition(neighbours, 5, axis=0)[5] + _DARK
    above = luminance[rows, columns] > bound
    return rows[above], columns[above], bound[above]


def _supporting_samples(
    luminance: Picture,
    square: Picture,
    samples: Picture,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
) -> Picture:
    """Return the number of samples around some pixels that are as bright as the brightest of the pixel.

    A sample that is darker counts as the square of the ratio; one that is brighter counts as one.
    """
    brightest = square / np.maximum(luminance, 1e-12)
    count = np.zeros(len(rows))
    height, width = luminance.shape
    for y in range(-REACH, REACH + 1):
        for x in range(-REACH, REACH + 1):
            inside = (rows + y >= 0) & (rows + y < height) & (columns + x >= 0) & (columns + x < width)
            near = np.clip(rows + y, 0, height - 1), np.clip(columns + x, 0, width - 1)
            bright = np.maximum(brightest[rows, columns], brightest[near])
            count += inside * samples[near] * square[near] / (bright * bright)
    return count


def _with_spread(removed: FireflyFilter, luminance: Picture) -> FireflyFilter:
    """Return a filter that spreads the light which `removed` removes.

    Each pixel's light goes as far as it must to brighten its surroundings by no more than BRIGHTENING. What
    is too bright for the whole picture stays.
    """
    excess = (1.0 - removed.kept) * luminance
    waiting, subject = excess > 0.0, removed.on_subject
    spread, reached, radius_of = removed.spread.copy(), removed.reached.copy(), removed.radius.copy()
    reaches = [radius for radius in RADII if 8 * radius <= max(luminance.shape)]
    for radius in (*reaches, EVERYWHERE):
        if not waiting.any():
            break
        within = [_blurred(np.where(part, removed.brightness, 0.0), radius) for part in (subject, ~subject)]
        light = np.where(subject, *within) + 1e-12
        peak = excess * _peak(radius) / light
        chosen = waiting if radius == EVERYWHERE else waiting & (peak <= BRIGHTENING)
        part = BRIGHTENING / np.maximum(peak, BRIGHTENING)
        spread[chosen] = ((1.0 - removed.kept) * part)[chosen]
        reached[chosen], radius_of[chosen] = light[chosen], radius
        waiting = waiting & ~chosen
    return replace(removed, kept=1.0 - spread, spread=spread, reached=reached, radius=radius_of)


def _blurred(picture: Picture, radius: int) -> Picture:
    """Return a picture (H, W) after two box blurs; EVERYWHERE gives each pixel the sum of all.

    Beyond the edges all is black, which makes the blur symmetric: what one pixel gives another is what it
    would get from it.
    """
    if radius == EVERYWHERE:
        return np.full_like(picture, picture.sum())
    for axis in (0, 1, 0, 1):
        picture = _box_means(picture, radius, axis)
    return picture


def _box_means(picture: Picture, radius: int, axis: int) -> Picture:
    """Return means over `radius` pixels to each side along an axis."""
    width, length = 2 * radius + 1, picture.shape[axis]
    padding = [(0, 0), (0, 0)]
    padding[axis] = (radius + 1, radius)
    sums = np.cumsum(np.pad(picture, padding), axis=axis)
    if axis == 0:
        return np.asarray((sums[width:] - sums[:length]) / width)
    return np.asarray((sums[:, width:] - sums[:, :length]) / width)


def _peak(radius: int) -> float:
    """Return the most that a pixel gets from itself by `_blurred`."""
    return 1.0 if radius == EVERYWHERE else 1.0 / (2 * radius + 1) ** 2


def _rounded(fraction: float) -> float:
    return float(f"{max(fraction, 0.0):.3g}") if fraction > 1e-9 else 0.0
