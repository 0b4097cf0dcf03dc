"""Procedural patterns in rest positions, so that colours move with the material.

A pattern gives every vertex one number, its *phase*, which faces interpolate; a colour ramp maps phases to
colours. Borders between colours are therefore as sharp as the picture, however long the edges are: only
their course is cut into straight pieces, one per face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.base.serialise import Colour, Triple

PATTERNS = ("layers", "gradient", "rings", "marble", "speckles")
TEXELS = 2048
"""Colours in the ramp of a pattern."""

Phases = NDArray[np.float64]


@dataclass(frozen=True)
class Pigment:
    """A pattern and its colours.

    pattern     "layers" (repeated along the axis), "gradient" (along the axis), "rings" (around the axis;
                the last one continues outwards), "marble" (veins across the axis) or "speckles"
    colours     linear Rec.709 reflectances, two or more. Layers and rings: in order from the centre.
                Gradient: along the axis. Marble and speckles: the ground, then the colours on it
    scale       scene units: thickness of a layer or ring, length of a gradient, distance between veins, size
                of the cells of speckles
    axis        direction of the pattern
    centre      origin of the pattern; the middle of a gradient
    softness    width of borders, as a fraction of a layer, vein or speckle; 0 is as sharp as the picture
    share       marble and speckles: fraction of the ground that veins or the largest speckles cover
    turbulence  displacement of the pattern by noise, in scales
    octaves     of the noise, each half as large as the one before
    seed        of the noise and of the positions of speckles
    """

    pattern: str
    colours: tuple[Colour, ...]
    scale: float = 1.0
    axis: Triple = (0.0, 1.0, 0.0)
    centre: Triple = (0.0, 0.0, 0.0)
    softness: float = 0.04
    share: float = 0.25
    turbulence: float = 0.0
    octaves: int = 4
    seed: int = 0

    def __post_init__(self) -> None:
        if self.pattern not in PATTERNS:
            raise BadInputError(f"pigment has pattern {self.pattern!r}; it can be {', '.join(PATTERNS)}")
        if len(self.colours) < 2:
            raise BadInputError(f"pigment has {len(self.colours)} colours; a pattern shows two or more")
        if not all(0.0 <= part <= 1.0 for colour in self.colours for part in colour):
            raise BadInputError("pigment has a colour out of range; reflectances lie between 0 and 1")
        if self.scale <= 0.0 or math.hypot(*self.axis) < 1e-12:
            raise BadInputError(f"pigment has scale {self.scale} and axis {self.axis}; neither may be zero")
        if self.turbulence < 0.0 or self.octaves < 1:
            raise BadInputError(
                f"pigment has turbulence {self.turbulence} and {self.octaves} octaves; the least are 0 and 1"
            )
        for name in ("softness", "share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"pigment has {name} {getattr(self, name)}; it lies between 0 and 1")

    @property
    def repeats(self) -> bool:
        """True if the colour ramp repeats; otherwise its end colours continue."""
        return self.pattern in ("layers", "marble")

    def phases(self, points: NDArray[np.floating]) -> Phases:
        """Return the phases (V,) of rest positions (V, 3). The ramp spans phases 0 to 1."""
        local = (np.asarray(points, dtype=np.float64) - self.centre) / self.scale
        axis = np.array(self.axis) / math.hypot(*self.axis)
        if self.turbulence:
            from render.scene.noise import fractal_noise  # numba is slow to import, and few looks need it

            local = local + self.turbulence * fractal_noise(local, self.octaves, self.seed)
        if self.pattern == "speckles":
            from render.scene.noise import nearest_spot

            return nearest_spot(local, self.seed)
        along = local @ axis
        if self.pattern == "rings":
            return np.asarray(np.linalg.norm(local - np.outer(along, axis), axis=1)) / len(self.colours)
        if self.pattern == "gradient":
            return along + 0.5
        return along / (len(self.colours) if self.pattern == "layers" else 1.0)

    def ramp(self) -> NDArray[np.float32]:
        """Return the colours (TEXELS, 3) of phases from 0 to 1."""
        phases = (np.arange(TEXELS) + 0.5) / TEXELS
        colours = np.array(self.colours, dtype=np.float64)
        if self.pattern == "gradient":
            stops = np.linspace(0.0, 1.0, len(colours))
            ramp = np.stack([np.interp(phases, stops, part) for part in colours.T], axis=1)
        elif self.pattern in ("layers", "rings"):
            ramp = self._bands(phases, colours)
        else:
            ramp = self._on_ground(phases, colours)
        return ramp.astype(np.float32)

    def _bands(self, phases: Phases, colours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return equal bands with borders of width `softness`, half of it on either side."""
        place = phases * len(colours)
        band, within = place.astype(int), place % 1.0
        half = max(self.softness, 1e-6) / 2.0
        before = _smooth(0.5 - within / (2.0 * half))[:, None]  # half at the border itself
        after = _smooth(0.5 - (1.0 - within) / (2.0 * half))[:, None]
        ends = colours[[-1, 0]] if self.repeats else colours[[0, -1]]  # beyond the first and the last band
        padded = np.concatenate([ends[:1], colours, ends[1:]])
        own, previous, following = padded[band + 1], padded[band], padded[band + 2]
        return np.asarray(own + before * (previous - own) + after * (following - own))

    def _on_ground(self, phases: Phases, colours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return veins, each in the middle of its part of the ramp, or speckles from the ramp's beginning."""
        ground, *others = colours
        ramp = np.tile(ground, (len(phases), 1))
        for index, colour in enumerate(others):
            if self.pattern == "speckles":
                distance, half = phases, self.share * (len(others) - index) / len(others)
            else:  # each vein is thinner than the one before
                distance = np.abs(phases - (index + 0.5) / len(others))
                half = 0.5 * self.share / len(others) / (index + 1)
            soft = max(self.softness * half, 1e-6)
            cover = _smooth((half - distance) / soft + 0.5)[:, None]
            ramp += cover * (colour - ramp)
        return ramp


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smoothstep of x: from 0 at 0 to 1 at 1, with slope 0 at both."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
