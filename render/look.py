"""What the sculpture is made of: plain descriptions that `render.scene` turns into materials."""

from __future__ import annotations

from dataclasses import dataclass

from render.errors import BadInputError
from render.pigment import Pigment
from render.plain import Triple

MODELS = ("diffuse", "plastic", "metal", "satin", "glass", "smoke")

CLEAR = ("glass", "smoke")
"""Models of bodies that light goes through: of closed surfaces only, and of one colour."""


@dataclass(frozen=True)
class Look:
    """A material; unless light goes through, the same on both sides of the surface.

    model       "diffuse" (chalk), "plastic" (a coloured body under a clear coat),
                "metal" (`colour` is what it reflects), "satin" (a lustrous cloth-like sheen and a soft coat),
                "glass" (clear, refracts; `colour` is what one passage through its surface lets through),
                "smoke" (a cloud that fills the surface)
    colour      linear Rec.709 reflectance
    roughness   of the coat or the metal: 0.03 is a mirror's gloss, 0.5 is matt
    sheen       of satin: how much lighter it is where it turns away, 0 … 1
    metallic    of satin: how much the highlight takes the colour, 0 … 1
    refraction  of glass: its index, 1.5 for window glass and honey
    density     of smoke: how often light is scattered on its way through half of the subject's size
    colour_from name of a vertex attribute (V, 3) that replaces `colour`, or none
    pigment     a pattern that replaces `colour` and moves with the material, or none
    """

    model: str
    colour: Triple
    roughness: float = 0.1
    sheen: float = 0.0
    metallic: float = 0.0
    refraction: float = 1.5
    density: float = 2.0
    colour_from: str | None = None
    pigment: Pigment | None = None

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise BadInputError(f"look has model {self.model!r}; it can be {', '.join(MODELS)}")
        if not all(0.0 <= part <= 1.0 for part in self.colour):
            raise BadInputError(f"look has colour {self.colour}; reflectances lie between 0 and 1")
        for name in ("roughness", "sheen", "metallic"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"look has {name} {getattr(self, name)}; it must lie between 0 and 1")
        if not (1.0 < self.refraction <= 4.0 and 0.0 < self.density <= 1000.0):
            raise BadInputError(
                f"look has refraction {self.refraction} and density {self.density}; the first lies above 1 "
                "and up to 4, the second above 0 and up to 1000"
            )
        if self.is_clear and (self.pigment or self.colour_from):
            raise BadInputError(f"a look of {self.model} has one colour; leave its pattern out")

    @property
    def is_clear(self) -> bool:
        """Whether light goes through."""
        return self.model in CLEAR


LOOKS = {
    "clay": Look("diffuse", (0.73, 0.595, 0.46)),
    "glaze": Look("plastic", (0.38, 0.012, 0.008), roughness=0.055),
    "chrome": Look("metal", (0.80, 0.81, 0.82), roughness=0.04),
    "taffy": Look("satin", (0.80, 0.26, 0.34), roughness=0.32, sheen=0.5, metallic=0.2),
    "pearl": Look("satin", (0.80, 0.76, 0.74), roughness=0.26, sheen=0.4, metallic=0.45),
    "cream": Look("plastic", (0.82, 0.71, 0.53), roughness=0.22),
    "coffee": Look("plastic", (0.045, 0.016, 0.006), roughness=0.07),
    "honey": Look("glass", (0.97, 0.62, 0.13), refraction=1.49),
    "glass": Look("glass", (0.97, 0.985, 0.98), refraction=1.5),
    "smoke": Look("smoke", (0.95, 0.95, 0.96), density=1.6),
}
