"""Colours in OKLCH (Ottosson 2020): lightness, chroma and hue, in which equal steps look equally large.

Shot files hold linear Rec.709. A subject and its stage are moved together, so that their hues keep their
distance, and are kept apart in lightness, so that the subject stands out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_TO_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)

DARKEST, BRIGHTEST = 0.004, 0.86
"""Reflectances between which colours stay: blacker and whiter ones lose their form in the picture."""


class Lch(NamedTuple):
    """A colour: lightness 0 to 1, chroma 0 to about 0.3, and hue in degrees."""

    lightness: float
    chroma: float
    hue: float

    def turned(self, degrees: float) -> Lch:
        """Return the colour with another hue."""
        return self._replace(hue=(self.hue + degrees) % 360.0)


def lab(linear: np.ndarray) -> np.ndarray:
    """Return OKLab (…, 3) of linear Rec.709 (…, 3)."""
    return np.cbrt(np.maximum(linear, 0.0) @ _TO_CONES.T) @ _TO_LAB.T


def lch(linear: list[float] | tuple[float, ...]) -> Lch:
    """Return a linear Rec.709 colour in OKLCH."""
    lightness, a, b = lab(np.array(linear, np.float64)).tolist()
    return Lch(lightness, math.hypot(a, b), math.degrees(math.atan2(b, a)) % 360.0)


def linear(colour: Lch) -> list[float]:
    """Return linear Rec.709 of a colour, with as much of its chroma as reflectances allow."""
    chroma = colour.chroma
    while True:
        angle = math.radians(colour.hue)
        values = np.array([colour.lightness, chroma * math.cos(angle), chroma * math.sin(angle)])
        rgb = np.linalg.solve(_TO_CONES, np.linalg.solve(_TO_LAB, values) ** 3)
        if chroma < 0.005 or (rgb.min() >= DARKEST and rgb.max() <= BRIGHTEST):
            return [round(float(value), 3) for value in np.clip(rgb, DARKEST, BRIGHTEST)]
        chroma *= 0.94


HUES = (
    (20, "rose"), (45, "red"), (70, "orange"), (105, "ochre"), (130, "lime"), (165, "green"),
    (215, "teal"), (270, "blue"), (320, "violet"), (350, "magenta"), (361, "rose"),
)  # fmt: skip
"""Names of hues, up to so many degrees."""


def colour_words(colour: Lch) -> str:
    """Return a colour in one or two words: `pale green`, `dark violet`, `grey`."""
    if colour.chroma < 0.025:
        return "black" if colour.lightness < 0.25 else "white" if colour.lightness > 0.88 else "grey"
    name = next(name for degrees, name in HUES if colour.hue < degrees)
    return f"{'dark ' if colour.lightness < 0.42 else 'pale ' if colour.lightness > 0.78 else ''}{name}"


APART = 0.2
"""Least difference in lightness between a subject and its stage, for hues that are alike."""

STAGE_CHROMA = 0.09
"""Most chroma of a stage: a stronger colour lies on the subject as light."""


def stage_for(stage: Lch, subject: Lch) -> Lch:
    """Return a stage's colour with little chroma and, if it is close to the subject's, another lightness."""
    calm = Lch(min(max(stage.lightness, 0.3), 0.78), min(stage.chroma, STAGE_CHROMA), stage.hue)
    differs = abs((calm.hue - subject.hue + 180.0) % 360.0 - 180.0)
    apart = APART * (1.0 - 0.4 * min(1.0, differs / 120.0) * min(1.0, subject.chroma / 0.1))
    gap = calm.lightness - subject.lightness
    if abs(gap) >= apart:
        return calm
    lighter, darker = subject.lightness + apart, subject.lightness - apart
    up = lighter <= 0.8 and (gap > 0.0 or darker < 0.28)
    return calm._replace(lightness=lighter if up else max(0.26, darker))
