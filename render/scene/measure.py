"""What a flow does to a surface, shown by colour: how fast it goes, and how far it has stretched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.scene.colour_maps import COLOUR_MAPS, colour_map
from render.scene.surface import Surface

Floats = NDArray[np.float64]

SPEED = "speed"
"""The attribute (V, 1) of a surface's vertices that the measure of that name shows."""


class Kind(NamedTuple):
    """Of a measure: its unit, its usual colours and range, and whether equal steps are equal factors."""

    unit: str
    colours: str
    low: float
    high: float
    by_factors: bool


KINDS = {
    "speed": Kind("scene units per second", "viridis", 0.0, 4.0, by_factors=False),
    "stretch": Kind("times as long", "inferno", 1.0, 4.0, by_factors=True),
    "area": Kind("times as large", "coolwarm", 0.25, 4.0, by_factors=True),
}


@dataclass(frozen=True)
class Measure:
    """A number at every point of a surface, and the colours that it is shown by.

    of         "speed": of the flow, scene units per second; "stretch": how many times as long the direction
               is that was lengthened most since the rest; "area": how many times as large the surface is
    colours    one of COLOUR_MAPS; None: that of the kind
    low, high  what its ends stand for, and all beyond; None: those of the kind. They are what is said, the
               same in every frame and shot, so that a colour always means the same and never flickers
    """

    of: str
    colours: str | None = None
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        if self.of not in KINDS:
            raise BadInputError(f"measure is of {self.of!r}; it can be {', '.join(KINDS)}")
        if self.colours is not None and self.colours not in COLOUR_MAPS:
            raise BadInputError(f"measure has colours {self.colours!r}; they can be {', '.join(COLOUR_MAPS)}")
        low, high = self.range
        if not low < high or (self.kind.by_factors and not low > 0.0):
            above = ", and above 0" if self.kind.by_factors else ""
            raise BadInputError(f"measure has range {low} to {high}; the first is below the second{above}")

    @property
    def kind(self) -> Kind:
        return KINDS[self.of]

    @property
    def range(self) -> tuple[float, float]:
        low = self.kind.low if self.low is None else self.low
        return low, self.kind.high if self.high is None else self.high

    def row(self) -> NDArray[np.float32]:
        """(N, 3): the colours of phases from 0 to 1; beyond, the ends go on."""
        return colour_map(self.colours or self.kind.colours)

    def phases(self, surface: Surface) -> Floats:
        """(V,): where in the row of colours vertices lie. Raises BadInputError where that is unknown."""
        low, high = self.range
        found = self.values(surface)
        if self.kind.by_factors:
            found, low, high = np.log2(found), np.log2(low), np.log2(high)
        return np.asarray((found - low) / (high - low))

    def values(self, surface: Surface) -> Floats:
        """(V,): what is measured."""
        if self.of == "speed":
            if SPEED not in surface.attributes:
                raise BadInputError("look shows speed, and the surface does not say how fast its points go")
            return np.asarray(surface.attributes[SPEED], dtype=np.float64).reshape(-1)
        if surface.material is None:
            raise BadInputError(
                f"look shows {self.of}, and the surface does not say where its points were; give it material"
            )
        if not len(surface.faces):
            raise BadInputError(f"look shows {self.of}, which is measured on triangles; a cloud has none")
        longest, shortest = stretches(surface.material, surface.vertices, surface.faces)
        measured = longest if self.of == "stretch" else longest * shortest
        return at_vertices(measured, surface)


def stretches(
    rest: NDArray[np.floating], now: NDArray[np.floating], faces: NDArray[np.int32]
) -> tuple[Floats, Floats]:
    """(F,) twice: the larger and the smaller principal stretch of triangles, from their places at rest.

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
    """(V,): the geometric mean of the faces (F,) around each vertex, by their areas at rest.

    Both sides of a crease have their own.
    """
    assert surface.material is not None
    before = _gram(surface.material, surface.faces)
    weight = np.sqrt(np.maximum(before[0] * before[2] - before[1] ** 2, 0.0))
    share = np.log(np.maximum(measured, 1e-6)) * weight
    corners, count = surface.faces.reshape(-1), len(surface.vertices)
    total = np.bincount(corners, np.repeat(share, 3), count)
    around = np.bincount(corners, np.repeat(weight, 3), count)
    return np.asarray(np.exp(total / np.where(around > 0.0, around, 1.0)))


def _gram(points: NDArray[np.floating], faces: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    """(F,) thrice: products of two edges of each triangle, the first's with itself, both, the second's."""
    a, b, c = points.astype(np.float64)[faces].transpose(1, 0, 2)
    first, second = b - a, c - a
    return (first * first).sum(axis=1), (first * second).sum(axis=1), (second * second).sum(axis=1)
