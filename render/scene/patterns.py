"""Colours by a number at each point: procedural patterns.

A colour ramp maps the number, a *phase*, to colours, so borders between them are as sharp as the picture.
Patterns are computed in rest positions, so they move with the material: at every sample of a picture in
compiled variants (`flowsculpt.render.mitsuba.pattern_textures`) and previews, elsewhere at vertices, between
which faces interpolate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple
from flowsculpt.render.scene.surface import Surface

CELLS = ("spots", "chips")
"""Patterns of cells with one colour each: phases jump from cell to cell."""

PATTERNS = ("layers", "gradient", "rings", "radial", "marble", "speckles", *CELLS, "palette")
TEXELS = 2048
"""Colours in the ramp of a pattern."""

COPY_PLACE = "copy_place"
"""Name of the vertex attribute (V, 3) where patterns of one colour for each copy are evaluated."""

OUTSIDE = -0.02
"""Depth in a spot or chip that stands for all outside."""

Phases = NDArray[np.float64]


@dataclass(frozen=True)
class Pigment:
    """A pattern and its colours.

    pattern     "layers" (repeated along the axis), "gradient" (along the axis), "rings" (around the axis;
                the last one continues outwards), "radial" (shells around the centre, repeated), "marble"
                (veins across the axis), "speckles" (of all colours, one in the other), "spots" (round, of
                one colour each), "chips" (angular, of one colour each) or "palette" (each copy of a subject
                has one colour by chance)
    colours     linear Rec.709 reflectances, two or more. Layers, rings, radial: in order from the centre.
                Gradient: along the axis. Others: the ground, then the colours on it
    scale       scene units: thickness of a layer, ring or shell, length of a gradient, distance between
                veins, size of the cells of speckles, spots and chips
    axis        direction of the pattern
    centre      origin of the pattern; the middle of a gradient
    softness    width of borders, as a fraction of a layer, vein or speckle, of the radius of a spot, or of
                half a cell of chips; 0 is as sharp as the picture
    share       marble and speckles: fraction of the ground that veins or the largest speckles cover; spots:
                the radius of the largest, in cells; chips: the fraction of cells that have one
    turbulence  displacement of the pattern by noise, in scales
    octaves     of the noise, each half as large as the one before
    seed        of the noise and of the positions of speckles, spots and chips
    heights     relief: the height of each colour, scene units, or none. It changes shading only
    roughness   of each colour, or none for that of the material
    gap         between chips, in cells; some have more
    sizes       generations of chips, the smaller ones in the gaps of the larger ones
    per_copy    each copy of a subject has one colour, that at its middle at rest
    sampled     the version of what a sample of a picture shows of the same fields
    """

    pattern: str
    colours: tuple[Colour, ...]
    scale: float = 1.0
    axis: Triple = (0.0, 1.0, 0.0)
    centre: Triple = (0.0, 0.0, 0.0)
    softness: float = 0.04
    share: float = 0.25
    turbulence: float = 0.0
    octaves: int = 1
    seed: int = 0
    heights: tuple[float, ...] = field(default=(), metadata=OMIT_DEFAULT)
    roughness: tuple[float, ...] = field(default=(), metadata=OMIT_DEFAULT)
    gap: float = field(default=0.08, metadata=OMIT_DEFAULT)
    sizes: int = field(default=1, metadata=OMIT_DEFAULT)
    per_copy: bool = field(default=False, metadata=OMIT_DEFAULT)
    sampled: int = field(default=3, init=False)

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
        for name in ("heights", "roughness"):
            if (count := len(getattr(self, name))) not in (0, len(self.colours)):
                raise BadInputError(
                    f"pigment has {count} {name} and {len(self.colours)} colours; write one for each colour"
                )
        if not all(0.0 <= each <= 1.0 for each in self.roughness):
            raise BadInputError("pigment has a roughness out of range; each lies between 0 and 1")
        for name in ("softness", "share", "gap"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"pigment has {name} {getattr(self, name)}; it lies between 0 and 1")

    @property
    def repeats(self) -> bool:
        """True if the colour ramp repeats; otherwise its end colours continue."""
        return self.pattern in ("layers", "radial", "marble")

    @property
    def is_of_copies(self) -> bool:
        """True if phases are those of COPY_PLACE, which is the same all over a copy."""
        return self.per_copy or self.pattern == "palette"

    def copy_places(self, middles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places (N, 3) of COPY_PLACE for copies with middles (N, 3) at rest."""
        if self.pattern != "palette":
            return middles
        chosen = np.random.default_rng([self.seed, 4]).integers(len(self.colours), size=(len(middles), 1))
        return (chosen + 0.5) / len(self.colours) * (1.0, 0.0, 0.0)

    def places(self, surface: Surface) -> NDArray[np.float64]:
        """Return where the pattern is evaluated at vertices, (V, 3). Raises BadInputError without them."""
        if not self.is_of_copies:
            return surface.require_rest("look has a pigment")
        if COPY_PLACE not in surface.attributes:
            raise BadInputError("look has a colour for each copy, and the surface has no places of copies")
        return np.asarray(surface.attributes[COPY_PLACE], np.float64)

    @property
    def needs_samples(self) -> bool:
        """True if phases at vertices do not tell all."""
        return self.pattern in CELLS or bool(self.heights or self.roughness)

    def phases(self, points: NDArray[np.floating]) -> Phases:
        """Return the phases (V,) of places (V, 3). The ramp spans phases 0 to 1."""
        if self.pattern == "palette":
            return np.asarray(points, np.float64)[:, 0]
        local = (np.asarray(points, dtype=np.float64) - self.centre) / self.scale
        axis = np.array(self.axis) / math.hypot(*self.axis)
        if self.turbulence or self.pattern in ("speckles", *CELLS):
            from flowsculpt.render.scene.noise import chips, fractal_noise, spots  # numba is slow to import

        if self.turbulence:
            local = local + self.turbulence * fractal_noise(local, self.octaves, self.seed)
        if self.pattern in ("speckles", "spots"):
            choice, distance = spots(local, self.seed)
            if self.pattern == "speckles":
                return distance
            depth = 1.0 - distance / max(self.share, 1e-9)
        if self.pattern == "chips":
            choice, depth = chips(local, self.seed, self.share, self.gap, self.sizes)
        if self.pattern in CELLS:
            count = len(self.colours) - 1
            return np.asarray((np.floor(choice * count) + in_ramp(np.clip(depth, OUTSIDE, 1.0))) / count)
        if self.pattern == "radial":
            distance = np.maximum(np.linalg.norm(local, axis=1), 0.5 * self.softness)  # no border at 0
            return np.asarray(distance / len(self.colours))
        along = local @ axis
        if self.pattern == "rings":
            return np.asarray(np.linalg.norm(local - np.outer(along, axis), axis=1)) / len(self.colours)
        if self.pattern == "gradient":
            return along + 0.5
        return along / (len(self.colours) if self.pattern == "layers" else 1.0)

    def colours_at(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the colours (V, 3) of rest positions (V, 3), linear Rec.709."""
        return self.colours_of(self.phases(points))

    def colours_of(self, phases: Phases) -> NDArray[np.float64]:
        """Return the colours (V, 3) of phases (V,), linear Rec.709."""
        return looked_up(self.ramp(), phases % 1.0 if self.repeats else phases)

    def ramp(self, of: str = "colours") -> NDArray[np.float32]:
        """Return the colours (TEXELS, 3) of phases from 0 to 1; or "heights" or "roughness" (TEXELS, 1)."""
        phases = (np.arange(TEXELS) + 0.5) / TEXELS
        colours = np.array(getattr(self, of), dtype=np.float64).reshape(len(self.colours), -1)
        if self.pattern == "gradient":
            stops = np.linspace(0.0, 1.0, len(colours))
            ramp = np.stack([np.interp(phases, stops, part) for part in colours.T], axis=1)
        elif self.pattern in ("layers", "rings", "radial", "palette"):
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
        """Return veins, each in the middle of its part of the ramp, speckles from the ramp's beginning, or
        spots and chips, each deeper and deeper along its own part of the ramp."""
        ground, *others = colours
        ramp = np.tile(ground, (len(phases), 1))
        for index, colour in enumerate(others):
            if self.pattern in CELLS:
                place = phases * len(others) - index
                depth = (place - in_ramp(0.0)) / (in_ramp(1.0) - in_ramp(0.0))
                cover = _smooth(depth / max(self.softness, 1e-6))
                cover[(place < 0.0) | (place >= 1.0)] = 0.0
                ramp += cover[:, None] * (colour - ramp)
                continue
            if self.pattern == "speckles":
                distance, half = phases, self.share * (len(others) - index) / len(others)
            else:  # each vein is thinner than the one before
                distance = np.abs(phases - (index + 0.5) / len(others))
                half = 0.5 * self.share / len(others) / (index + 1)
            soft = max(self.softness * half, 1e-6)
            cover = _smooth((half - distance) / soft + 0.5)[:, None]
            ramp += cover * (colour - ramp)
        return ramp


def looked_up(ramp: NDArray[np.float32], phases: Phases) -> NDArray[np.float64]:
    """Return the colours (V, 3) of phases (V,) in a ramp (N, 3). Beyond 0 and 1 its end colours continue."""
    places = (np.clip(phases, 0.0, 1.0) * len(ramp)).astype(int)
    return np.asarray(ramp[np.minimum(places, len(ramp) - 1)], dtype=np.float64)


def in_ramp(depth: Any) -> Any:
    """Return the place from 0 to 1 of a depth from OUTSIDE to 1 in the part of the ramp of a cell's colour.

    Both ends of that part are not used, since lookups blend neighbours.
    """
    return 0.01 + 0.98 * (depth - OUTSIDE) / (1.0 - OUTSIDE)


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smoothstep of x: from 0 at 0 to 1 at 1, with slope 0 at both."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
