"""Fine detail of surfaces: finishes of floors and walls, and wear of looks.

Layers of noise in three dimensions, so they neither repeat nor show seams. Each has a size, and fades where
the lens is so far away that it would only be noise. Wear is in rest positions: it flows with the sculpture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple


@dataclass(frozen=True)
class DetailLayer:
    """One layer of detail.

    pattern    "noise", "lines" (thin and long), "weave" (threads), "grooves" (across the second axis),
               "prints" (of fingers, here and there) or "dust" (specks, most where the surface faces up)
    scale      size along each axis: of floors in stage units, of looks in scene units
    height     of its relief, the same units
    darkness   fraction of the colour that is lost where the layer is strongest
    roughness  that is added there
    tint       colour that it mixes in by its strength, or None
    octaves    of noise
    """

    pattern: str
    scale: Triple
    height: float = 0.0
    darkness: float = 0.0
    roughness: float = 0.0
    tint: Colour | None = field(default=None, metadata=OMIT_DEFAULT)
    octaves: int = 1


FINISHES: dict[str, tuple[float | None, tuple[DetailLayer, ...]]] = {
    "polished": (
        0.03,
        (
            DetailLayer("noise", (1.7, 1.7, 1.7), darkness=0.22, roughness=0.05, octaves=5),
            DetailLayer("lines", (0.9, 0.05, 0.05), roughness=0.05),
            DetailLayer("noise", (0.05, 0.05, 0.05), darkness=0.1, octaves=2),
        ),
    ),
    "concrete": (
        None,
        (
            DetailLayer("noise", (2.6, 2.6, 2.6), darkness=0.34, octaves=6),
            DetailLayer("noise", (0.11, 0.11, 0.11), height=0.005, darkness=0.16, octaves=4),
            DetailLayer("prints", (1.1, 1.1, 1.1), darkness=0.1),
        ),
    ),
    "paper": (
        None,
        (
            DetailLayer("noise", (0.5, 0.5, 0.5), darkness=0.05, octaves=3),
            DetailLayer("noise", (0.035, 0.012, 0.035), height=0.0016, darkness=0.05, octaves=3),
        ),
    ),
    "felt": (
        None,
        (
            DetailLayer("noise", (0.7, 0.7, 0.7), darkness=0.14, octaves=4),
            DetailLayer("lines", (0.12, 0.02, 0.02), height=0.004, darkness=0.24),
            DetailLayer("noise", (0.03, 0.03, 0.03), height=0.006, darkness=0.3, octaves=3),
        ),
    ),
    "water": (
        0.01,
        (
            DetailLayer("noise", (1.3, 1.3, 0.55), height=0.012, octaves=2),
            DetailLayer("noise", (0.32, 0.32, 0.16), height=0.0022, octaves=2),
        ),
    ),
}
"""Finishes of floors and walls by name: the roughness of a coat, None for a matt one, and layers."""

WEAR: dict[str, DetailLayer] = {
    "dust": DetailLayer("dust", (0.018, 0.018, 0.018), roughness=0.45, tint=(0.56, 0.53, 0.48), octaves=3),
    "fingerprints": DetailLayer("prints", (0.34, 0.34, 0.34), roughness=0.22, darkness=0.05),
    "scratches": DetailLayer("lines", (0.5, 0.014, 0.014), height=0.0011, darkness=0.18, roughness=0.16),
    "weave": DetailLayer("weave", (0.034, 0.034, 0.034), height=0.0042, darkness=0.22),
    "tool_marks": DetailLayer("grooves", (0.6, 0.075, 0.6), height=0.0045, darkness=0.06),
}
"""Kinds of wear in full strength, for a sculpture about 2 scene units large."""


def worn(amounts: Mapping[str, float]) -> tuple[DetailLayer, ...]:
    """Return layers of wear of these amounts, 0 to 1. Raises BadInputError for an unknown kind."""
    layers = []
    for name, amount in amounts.items():
        if name not in WEAR or not 0.0 <= amount <= 1.0:
            raise BadInputError(f"look has wear {name}: {amount}; write {', '.join(WEAR)}, each from 0 to 1")
        full = WEAR[name]
        if amount > 0.0:
            layers.append(
                DetailLayer(
                    full.pattern,
                    full.scale,
                    amount * full.height,
                    amount * full.darkness,
                    amount * full.roughness,
                    full.tint,
                    full.octaves,
                )
            )
    return tuple(layers)
