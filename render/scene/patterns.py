"""Colour that moves with the material: patterns in the places that points had before anything moved them.

A pattern gives every vertex one number, its *phase*, which faces interpolate; a row of colours says what a
phase looks like. Borders between colours are therefore as sharp as the picture, however long the edges are:
only their course is cut into straight pieces, one a face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.noise import fractal_noise, nearest_spot

PATTERNS = ("layers", "gradient", "rings", "marble", "speckles")
TEXELS = 2048
"""Colours in the row of a pattern."""

Phases = NDArray[np.float64]


@dataclass(frozen=True)
class Pigment:
    """A pattern and its colours.

    pattern     "layers", one above the other along the axis, again and again; "gradient", from one end of
                the axis to the other; "rings" around the axis, the last of which goes on outwards; "marble",
                veins across the axis; "speckles"
    colours     linear Rec.709 reflectances, two or more: of layers and rings in their order, the first from
                the centre on; of a gradient along the axis; of others the ground, and then what is on it
    scale       scene units: the thickness of a layer or ring, the length of a gradient, the distance between
                veins, the size of the cells that speckles lie in
    axis        direction in which the pattern goes on
    centre      where it begins; a gradient has its middle there
    softness    which share of a layer, a vein or a speckle its border takes: 0 is as sharp as the picture
    share       of marble and speckles: how much of the ground the veins or the largest speckles take
    turbulence  how far the pattern is displaced by noise, in scales
    octaves     of the noise, each half as large as the one before
    seed        of the noise and of where speckles are
    """

    pattern: str
    colours: tuple[Triple, ...]
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
                f"pigment has turbulence {self.turbulence} and {self.octaves} octaves; 0 and 1 are the least"
            )
        for name in ("softness", "share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"pigment has {name} {getattr(self, name)}; it lies between 0 and 1")

    @property
    def repeats(self) -> bool:
        """Whether the row of colours begins again after its end; otherwise the ends go on."""
        return self.pattern in ("layers", "marble")

    def phases(self, points: NDArray[np.floating]) -> Phases:
        """(V,): where in the row of colours points (V, 3) of the undeformed surface lie; 0 … 1 is one row."""
        away = (np.asarray(points, dtype=np.float64) - self.centre) / self.scale
        axis = np.array(self.axis) / math.hypot(*self.axis)
        if self.turbulence:
            away = away + self.turbulence * fractal_noise(away, self.octaves, self.seed)
        if self.pattern == "speckles":
            return nearest_spot(away, self.seed)
        along = away @ axis
        if self.pattern == "rings":
            return np.asarray(np.linalg.norm(away - np.outer(along, axis), axis=1)) / len(self.colours)
        if self.pattern == "gradient":
            return along + 0.5
        return along / (len(self.colours) if self.pattern == "layers" else 1.0)

    def row(self) -> NDArray[np.float32]:
        """(TEXELS, 3): the colours of phases from 0 to 1."""
        phases = (np.arange(TEXELS) + 0.5) / TEXELS
        colours = np.array(self.colours, dtype=np.float64)
        if self.pattern == "gradient":
            at = np.linspace(0.0, 1.0, len(colours))
            row = np.stack([np.interp(phases, at, part) for part in colours.T], axis=1)
        elif self.pattern in ("layers", "rings"):
            row = self._bands(phases, colours)
        else:
            row = self._upon_ground(phases, colours)
        return row.astype(np.float32)

    def _bands(self, phases: Phases, colours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Equal bands; a border is as wide as `softness`, half of it on either side."""
        place = phases * len(colours)
        band, within = place.astype(int), place % 1.0
        half = max(self.softness, 1e-6) / 2.0
        before = _smooth(0.5 - within / (2.0 * half))[:, None]  # half way at the border itself
        after = _smooth(0.5 - (1.0 - within) / (2.0 * half))[:, None]
        ends = colours[[-1, 0]] if self.repeats else colours[[0, -1]]  # before and after them
        around = np.concatenate([ends[:1], colours, ends[1:]])
        own, last, following = around[band + 1], around[band], around[band + 2]
        return np.asarray(own + before * (last - own) + after * (following - own))

    def _upon_ground(self, phases: Phases, colours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Veins in the middle of their part of the row, one after the other; speckles from its beginning."""
        ground, *others = colours
        row = np.tile(ground, (len(phases), 1))
        for index, colour in enumerate(others):
            if self.pattern == "speckles":
                away, half = phases, self.share * (len(others) - index) / len(others)
            else:  # each vein is thinner than the one before
                away = np.abs(phases - (index + 0.5) / len(others))
                half = 0.5 * self.share / len(others) / (index + 1)
            soft = max(self.softness * half, 1e-6)
            cover = _smooth((half - away) / soft + 0.5)[:, None]
            row += cover * (colour - row)
        return row


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 at 0 to 1 at 1, level at both."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
