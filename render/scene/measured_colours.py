"""Measures: numbers at vertices, shown by palettes.

A palette maps a number to a colour by its *phase*, 0 at the low end of the range and 1 at the high end. The
range is the same in every frame, so that a colour always means the same number and never flickers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT, Triple
from flowsculpt.render.scene.palettes import (
    COLOUR_MAPS,
    REVERSED,
    blended,
    colour_map,
    is_diverging,
    require_installed,
)
from flowsculpt.render.scene.patterns import looked_up
from flowsculpt.render.scene.rgb_spaces import REC709, converted_pixels
from flowsculpt.render.scene.surface import Surface

Floats = NDArray[np.float64]

SHARES = (0.02, 0.98)
"""The fractions of values of all frames that lie below the ends of the range, where a shot names none."""

NEUTRAL = (0.16, 0.16, 0.165)
"""Linear Rec.709 of vertices whose value is missing."""

MISSING = -1.0
"""The phase of a vertex whose value is missing."""


class MeasureKind(NamedTuple):
    """Unit, default palette and default range of a measure; without numbers it follows from all values.

    is_logarithmic  True if equal steps of colour are factors
    """

    unit: str
    colours: str
    low: float | None
    high: float | None
    is_logarithmic: bool


KINDS = {
    "speed": MeasureKind("scene units per second", "viridis", 0.0, 4.0, is_logarithmic=False),
    "stretch": MeasureKind("times as long", "inferno", 1.0, 4.0, is_logarithmic=True),
    "area": MeasureKind("times as large", "coolwarm", 0.25, 4.0, is_logarithmic=True),
    Surface.VALUES: MeasureKind("", "viridis", None, None, is_logarithmic=False),
}

Quantiles = Callable[[Sequence[float]], Sequence[float]]
"""Returns the numbers below which fractions of the values of all frames lie."""


@dataclass(frozen=True)
class Measure:
    """A measured number at every vertex, and the palette that shows it.

    of         "speed" (of the flow, scene units per second), "stretch" (largest principal stretch since the
               rest positions), "area" (area over area at rest) or "values" (what the subject measures)
    colours    one of COLOUR_MAPS, or with REVERSED at its end; None for the kind's own
    low, high  numbers at the ends of the palette; None for the kind's own
    shares     of `values`, in place of `low` and `high`: the fractions of all values below the ends
    own        colours of a palette of its own, in place of `colours`
    log        True if equal steps of colour are factors; None for the kind's own
    centre     the number in the middle of the palette, about which the range is widened until it is even;
               None: 0 where the palette has a middle, else none
    missing    linear Rec.709 of vertices whose value is missing

    working_space  the space that the palette is converted to
    quantiles      of the values of all frames; needed where the range follows from them
    """

    repeats: ClassVar[bool] = False
    """Beyond the palette its end colours continue."""

    of: str
    colours: str | None = None
    low: float | None = None
    high: float | None = None
    shares: tuple[float | None, float | None] = field(default=(None, None), metadata=OMIT_DEFAULT)
    own: tuple[Triple, ...] = field(default=(), metadata=OMIT_DEFAULT)
    log: bool | None = field(default=None, metadata=OMIT_DEFAULT)
    centre: float | None = field(default=None, metadata=OMIT_DEFAULT)
    missing: Triple = field(default=NEUTRAL, metadata=OMIT_DEFAULT)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)
    quantiles: Quantiles | None = field(default=None, metadata=NOT_PLAIN, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.of not in KINDS:
            raise BadInputError(f"measure is of {self.of!r}; it can be {', '.join(KINDS)}")
        if self.colours is not None and self.colours.removesuffix(REVERSED) not in COLOUR_MAPS:
            raise BadInputError(f"measure has colours {self.colours!r}; they can be {', '.join(COLOUR_MAPS)}")
        require_installed(self.palette)
        if len(self.own) == 1:
            raise BadInputError("measure has 1 colour; a palette has two or more")
        if self.of != Surface.VALUES and self.shares != (None, None):
            raise BadInputError(
                f"measure of {self.of} has a range in percent, which values have; write numbers"
            )
        low, high = self._numbers
        if self.is_logarithmic and any(end is not None and end <= 0.0 for end in (low, high, self.centre)):
            ends = " and ".join(f"{end:g}" for end in (low, high, self.centre) if end is not None)
            raise BadInputError(f"measure shows {ends} by a logarithm, which needs numbers above 0")
        if low is not None and high is not None:
            self._require_ascending(low, high)

    def _require_ascending(self, low: float, high: float) -> None:
        if not low < high:
            raise BadInputError(f"measure has range {low} to {high}; the first is below the second")
        if self._middle is not None and not low < self._middle < high:
            raise BadInputError(
                f"measure has range {low} to {high}, and {self._middle:g}, the middle of its palette, is not "
                "between them (centre sets another)"
            )

    @property
    def kind(self) -> MeasureKind:
        """The kind that `of` names."""
        return KINDS[self.of]

    @property
    def palette(self) -> str:
        """The name of the palette; empty for one of its own."""
        return "" if self.own else self.colours or self.kind.colours

    @property
    def is_logarithmic(self) -> bool:
        """True if equal steps of colour are factors."""
        return self.kind.is_logarithmic if self.log is None else self.log

    @property
    def follows_all_frames(self) -> bool:
        """True if an end of the range follows from the values of all frames."""
        return None in self._numbers

    @property
    def _numbers(self) -> tuple[float | None, float | None]:
        """The ends of the range that are numbers, before it is made even; None for the others."""
        low, high = self.shares
        return (
            (self.kind.low if self.low is None else self.low) if low is None else None,
            (self.kind.high if self.high is None else self.high) if high is None else None,
        )

    @property
    def _middle(self) -> float | None:
        """The number in the middle of the palette; None where its ends say all."""
        if self.centre is not None or self.of != Surface.VALUES or self.is_logarithmic:
            return self.centre
        return 0.0 if is_diverging(self.palette) else None

    @cached_property
    def range(self) -> tuple[float, float]:
        """Numbers at the ends of the palette.

        Raises BadInputError where a logarithm would reach 0, and what `quantiles` raises.
        """
        low, high = self._numbers
        if low is None or high is None:
            asked = [
                default if share is None else share
                for share, default in zip(self.shares, SHARES, strict=True)
            ]
            if self.quantiles is None:
                raise BadInputError("look shows values, and the surface has none; give it values")
            found = self.quantiles(asked)
            low, high = (found[0] if low is None else low), (found[1] if high is None else high)
            if self.is_logarithmic and not low > 0.0:
                raise BadInputError(
                    f"look shows values by their logarithm, and they reach down to {low:g}; write a range of "
                    "numbers above 0, or leave log out"
                )
            if not low < high:  # all are equal
                low, high = (0.5 * low, 2.0 * low) if self.is_logarithmic else (low - 0.5, low + 0.5)
        if self._middle is None:
            return low, high
        if self.is_logarithmic:
            factor = max(self._middle / low, high / self._middle)
            return self._middle / factor, self._middle * factor
        half = max(self._middle - low, high - self._middle)
        return self._middle - half, self._middle + half

    def ramp(self) -> NDArray[np.float32]:
        """Return the colours (N, 3) of phases from 0 to 1. Raises BadInputError for a palette that lacks."""
        row = blended(self.own) if self.own else colour_map(self.palette)
        return converted_pixels(row, self.working_space)

    def ramp_with_missing(self) -> NDArray[np.float32]:
        """Return a row (2N, 3): its first half is the colour of missing values, its second half `ramp`."""
        ramp = self.ramp()
        missing = converted_pixels(np.array([self.missing], np.float32), self.working_space)
        return np.concatenate([np.broadcast_to(missing, ramp.shape), ramp])

    def colours_of(self, phases: Floats) -> Floats:
        """Return the colours (V, 3) of phases (V,)."""
        if self.of != Surface.VALUES:
            return looked_up(self.ramp(), phases)
        return looked_up(self.ramp_with_missing(), self.places_of(phases))

    @staticmethod
    def places_of(phases: Floats) -> Floats:
        """Return the places (V,), 0 to 1, of phases in `ramp_with_missing`."""
        half_texel = 0.5 / 512.0
        return np.where(
            phases == MISSING, 0.25, 0.5 + half_texel + (0.5 - half_texel) * np.clip(phases, 0.0, 1.0)
        )

    def phases(self, surface: Surface) -> Floats:
        """Return the phases (V,) of vertices: 0 at the range's low end, 1 at its high end. Raises as
        `values` and `range`. Those of vertices without a value are MISSING."""
        low, high = self.range
        values = self.values(surface)
        if self.is_logarithmic:
            with np.errstate(divide="ignore", invalid="ignore"):
                values, low, high = np.log2(np.maximum(values, 1e-300)), np.log2(low), np.log2(high)
        phases = (values - low) / (high - low)
        if self.of != Surface.VALUES:
            return np.asarray(phases)
        return np.where(np.isnan(values), MISSING, np.clip(phases, 0.0, 1.0))

    def values(self, surface: Surface) -> Floats:
        """Return the measured numbers (V,); NaN where one is missing.

        Raises BadInputError where the surface lacks what they need.
        """
        if self.of == Surface.VALUES:
            return values_at_vertices(surface)
        if self.of == "speed":
            if Surface.SPEED not in surface.attributes:
                raise BadInputError("look shows speed, but the surface has no velocities")
            return np.asarray(surface.attributes[Surface.SPEED], dtype=np.float64).reshape(-1)
        rest = surface.require_rest(f"look shows {self.of}")
        if not len(surface.faces):
            raise BadInputError(f"look shows {self.of}, which needs triangles; clouds support only speed")
        longest, shortest = principal_stretches(rest, surface.vertices, surface.faces)
        measured = longest if self.of == "stretch" else longest * shortest
        return at_vertices(measured, surface)


def shows_values(pattern: Any) -> TypeGuard[Measure]:
    """Tell whether a pattern is a measure of values, some of which may be missing."""
    return isinstance(pattern, Measure) and pattern.of == Surface.VALUES


def values_at_vertices(surface: Surface) -> Floats:
    """Return the values (V,) of a surface; NaN where they are missing. Raises BadInputError without any."""
    if Surface.VALUES not in surface.attributes:
        raise BadInputError("look shows values, and the surface has none; give it values")
    summed, known = np.asarray(surface.attributes[Surface.VALUES], np.float64).T
    return np.where(known > 0.5, summed / np.where(known > 0.5, known, 1.0), np.nan)


def with_known(values: Any) -> Floats:
    """Return the attribute VALUES (V, 2) of values (V,), NaN where they are missing.

    Its columns are the value, or 0, and 1 where it is known, or 0. Both are interpolated between vertices;
    their quotient is the value there.
    """
    given = np.asarray(values, np.float64)
    known = np.isfinite(given)
    return np.stack([np.where(known, given, 0.0), known.astype(np.float64)], axis=1)


def principal_stretches(
    rest: NDArray[np.floating], now: NDArray[np.floating], faces: NDArray[np.int32]
) -> tuple[Floats, Floats]:
    """Return the larger and the smaller principal stretch of triangles since their rest, (F,) each.

    The deformation gradient F of a triangle is constant and maps its edges E at rest to its edges e now.
    Stretches are its singular values: the roots of the eigenvalues of FᵀF, which in the basis E are those
    of (EᵀE)⁻¹(eᵀe), with half the trace t and the determinant J²: λ² = t ± √(t² − J²). J is the change of
    area. (J. Bonet, R. Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*, 2008, chapter 4;
    constant-strain triangles.) A triangle without area at rest has stretches 1.
    """
    before, after = _gram(rest, faces), _gram(now, faces)
    area = before[0] * before[2] - before[1] ** 2
    flat = area <= 1e-14 * (before[0] + before[2]) ** 2
    area = np.where(flat, 1.0, area)
    half_trace = 0.5 * (before[2] * after[0] - 2.0 * before[1] * after[1] + before[0] * after[2]) / area
    determinant = np.maximum(after[0] * after[2] - after[1] ** 2, 0.0) / area
    root = np.sqrt(np.maximum(half_trace**2 - determinant, 0.0))
    longest = np.sqrt(half_trace + root)
    shortest = np.sqrt(determinant) / np.maximum(longest, 1e-30)
    return np.where(flat, 1.0, longest), np.where(flat, 1.0, shortest)


def at_vertices(measured: Floats, surface: Surface) -> Floats:
    """Return the geometric means (V,) of numbers (F,) over the faces of each vertex, weighted by rest area.

    Both sides of a crease have their own vertices, so their own means.
    """
    assert surface.rest is not None
    before = _gram(surface.rest, surface.faces)
    weight = np.sqrt(np.maximum(before[0] * before[2] - before[1] ** 2, 0.0))
    share = np.log(np.maximum(measured, 1e-6)) * weight
    corners, count = surface.faces.reshape(-1), len(surface.vertices)
    total = np.bincount(corners, np.repeat(share, 3), count)
    weights = np.bincount(corners, np.repeat(weight, 3), count)
    return np.asarray(np.exp(total / np.where(weights > 0.0, weights, 1.0)))


def _gram(points: NDArray[np.floating], faces: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    """Return the dot products of two edges a, b of each triangle: a·a, a·b and b·b, (F,) each."""
    a, b, c = points.astype(np.float64)[faces].transpose(1, 0, 2)
    first, second = b - a, c - a
    return (first * first).sum(axis=1), (first * second).sum(axis=1), (second * second).sum(axis=1)
