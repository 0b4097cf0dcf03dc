"""What the sculpture is made of: plain descriptions that `render.scene` turns into materials."""

from __future__ import annotations

from dataclasses import dataclass

from render.errors import BadInputError
from render.plain import Triple

MODELS = ("diffuse", "plastic", "metal", "satin")


@dataclass(frozen=True)
class Look:
    """A material, the same on both sides of the surface.

    model       "diffuse" (chalk), "plastic" (a coloured body under a clear coat),
                "metal" (`colour` is what it reflects), "satin" (a lustrous cloth-like sheen and a soft coat)
    colour      linear Rec.709 reflectance
    roughness   of the coat or the metal: 0.03 is a mirror's gloss, 0.5 is matt
    sheen       of satin: how much lighter it is where it turns away, 0 … 1
    metallic    of satin: how much the highlight takes the colour, 0 … 1
    colour_from name of a vertex attribute (V, 3) that replaces `colour`, or none
    """

    model: str
    colour: Triple
    roughness: float = 0.1
    sheen: float = 0.0
    metallic: float = 0.0
    colour_from: str | None = None

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise BadInputError(f"look has model {self.model!r}; it can be {', '.join(MODELS)}")
        if not all(0.0 <= part <= 1.0 for part in self.colour):
            raise BadInputError(f"look has colour {self.colour}; reflectances lie between 0 and 1")
        for name in ("roughness", "sheen", "metallic"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"look has {name} {getattr(self, name)}; it must lie between 0 and 1")


LOOKS = {
    "clay": Look("diffuse", (0.73, 0.595, 0.46)),
    "glaze": Look("plastic", (0.38, 0.012, 0.008), roughness=0.055),
    "chrome": Look("metal", (0.80, 0.81, 0.82), roughness=0.04),
    "taffy": Look("satin", (0.80, 0.26, 0.34), roughness=0.32, sheen=0.5, metallic=0.2),
    "pearl": Look("satin", (0.80, 0.76, 0.74), roughness=0.26, sheen=0.4, metallic=0.45),
}
