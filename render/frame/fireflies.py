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

from flowsculpt.render.base.kernel_cache import compiled

Picture = NDArray[np.float64]

BRIGHT_FACTOR = 3.0
"""Brightness of a pixel, over the third brightest of its eight neighbours, above which it is a firefly."""

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

_STRIP = 32
"""Columns that are blurred together: few enough that their sums stay in a core's cache."""


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
            share = np.where(part, self.brightness, 0.0)
            for radius in map(int, np.unique(radii[radii > 0])):
                box = _within_reach(radii == radius, radius)
                weight = np.where(radii[box] == radius, self.spread[box] / self.reached[box], 0.0)
                for channel in range(light.shape[2]):
                    near = *box, channel
                    filtered[near] += share[box] * _blurred(light[near] * weight, radius)
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
        return {name: _round(float(part.sum()) / total) for name, part in parts.items()}


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


def prepare() -> None:
    """Compile the kernels, so that the first frame need not wait for them."""
    picture = np.ones((1, 1))
    kept_fractions(picture, picture, picture, "soft")
    _blurred(picture, 1)


def kept_fractions(luminance: Picture, square: Picture, samples: Picture, treatment: str) -> Picture:
    """Return the fraction (H, W) of its light that each pixel keeps; arguments as for `find_fireflies`."""
    kept = np.ones_like(luminance)
    if treatment != "keep":
        _reduce_kept(luminance, square, samples, kept)
    return kept


@compiled()
def _reduce_kept(luminance: Picture, square: Picture, samples: Picture, kept: Picture) -> None:
    """Write the fraction of its light that each pixel keeps where it is less than 1; (H, W) each."""
    height, width = luminance.shape
    for y in range(height):
        for x in range(width):
            own = luminance[y, x]
            if samples[y, x] * own * own >= RELIABLE_COUNT * square[y, x]:
                continue  # of many samples by itself
            bound = BRIGHT_FACTOR * _third_brightest(luminance, y, x) + _DARK
            if own > bound:
                count = _supporting_samples(luminance, square, samples, y, x)
                reliability = min(max((count - 1.0) / (RELIABLE_COUNT - 1.0), 0.0), 1.0)
                kept[y, x] = (bound + reliability * (own - bound)) / own


@compiled()
def _third_brightest(luminance: Picture, y: int, x: int) -> float:
    """Return the third brightest of the eight neighbours of a pixel; pixels repeat beyond the edges."""
    height, width = luminance.shape
    first = second = third = -np.inf
    for row in range(y - 1, y + 2):
        for column in range(x - 1, x + 2):
            if row == y and column == x:
                continue
            value = luminance[min(max(row, 0), height - 1), min(max(column, 0), width - 1)]
            third = max(third, min(second, value))
            second = max(second, min(first, value))
            first = max(first, value)
    return third


@compiled()
def _supporting_samples(luminance: Picture, square: Picture, samples: Picture, y: int, x: int) -> float:
    """Return the number of samples around a pixel that are as bright as the brightest of the pixel.

    A sample that is darker counts as the square of the ratio; one that is brighter counts as one.
    """
    height, width = luminance.shape
    brightest = square[y, x] / max(luminance[y, x], 1e-12)
    count = 0.0
    for row in range(max(y - REACH, 0), min(y + REACH + 1, height)):
        for column in range(max(x - REACH, 0), min(x + REACH + 1, width)):
            near = square[row, column] / max(luminance[row, column], 1e-12)
            bright = max(brightest, near)
            count += samples[row, column] * square[row, column] / (bright * bright)
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
    blurred = np.empty_like(picture)
    for source in (picture, blurred):
        _blur_columns(source, radius, blurred)
        _blur_rows(blurred, radius)
    return blurred


def _within_reach(pixels: NDArray[np.bool_], radius: int) -> tuple[slice, slice]:
    """Return the rows and columns that `_blurred` reaches from pixels, True in (H, W)."""
    reached = []
    for axis in (1, 0):
        places = np.flatnonzero(pixels.any(axis=axis))
        reached.append(slice(max(int(places[0]) - 2 * radius, 0), int(places[-1]) + 2 * radius + 1))
    return reached[0], reached[1]


@compiled()
def _blur_columns(picture: Picture, radius: int, means: Picture) -> None:
    """Write means over `radius` pixels above and below, which may take the place of the picture."""
    height, width = picture.shape
    sums = np.zeros((height + 1, _STRIP))
    for left in range(0, width, _STRIP):
        columns = min(_STRIP, width - left)
        for y in range(height):
            for x in range(columns):
                sums[y + 1, x] = sums[y, x] + picture[y, left + x]
        for y in range(height):
            above, below = max(y - radius, 0), min(y + radius + 1, height)
            for x in range(columns):
                means[y, left + x] = (sums[below, x] - sums[above, x]) / (2 * radius + 1)


@compiled()
def _blur_rows(picture: Picture, radius: int) -> None:
    """Replace a picture by means over `radius` pixels to the left and right."""
    height, width = picture.shape
    sums = np.zeros(width + 1)
    for y in range(height):
        for x in range(width):
            sums[x + 1] = sums[x] + picture[y, x]
        for x in range(width):
            left, right = max(x - radius, 0), min(x + radius + 1, width)
            picture[y, x] = (sums[right] - sums[left]) / (2 * radius + 1)


def _peak(radius: int) -> float:
    """Return the most that a pixel gets from itself by `_blurred`."""
    return 1.0 if radius == EVERYWHERE else 1.0 / (2 * radius + 1) ** 2


def _round(fraction: float) -> float:
    return float(f"{max(fraction, 0.0):.3g}") if fraction > 1e-9 else 0.0
