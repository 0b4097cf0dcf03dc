"""What the sculpture is made of: plain descriptions that `render.mitsuba.scene` turns into materials."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.bsdf import Bsdf
from render.scene.measure import Measure
from render.scene.patterns import Pigment
from render.scene.texture_projection import Projection
from render.scene.textures import Texture
from render.scene.wireframe import Wireframe

MODELS = ("diffuse", "plastic", "metal", "brushed", "satin", "glass", "smoke", "gouraud", "bsdf")

CLEAR = ("glass", "smoke")
"""Models of bodies that light goes through: of closed surfaces only, and of one colour."""

PLAIN = (*CLEAR, "brushed")
"""Models of one colour: they take no pigment."""

COLOURED_BY = ("pigment", "measure", "picture", "colour_from")
"""What takes the place of a look's one colour."""

ROUGH = ("plastic", "metal", "satin")
"""Models whose roughness may be a picture."""


@dataclass(frozen=True)
class Absorption:
    """How a body takes light that goes through it: what is left falls with the distance (Beer and Lambert).

    colour  linear Rec.709: how much is left after `depth`; above 0
    depth   in halves of the subject's size
    """

    colour: Triple
    depth: float = 1.0

    def __post_init__(self) -> None:
        if not (all(0.0 < part <= 1.0 for part in self.colour) and 0.0 < self.depth <= 1000.0):
            raise BadInputError(
                f"absorption has colour {self.colour} and depth {self.depth}; colours lie above 0 and "
                "up to 1, depths above 0 and up to 1000"
            )

    @property
    def rate(self) -> Triple:
        """Of the exponential decay, in one half of the subject's size."""
        red, green, blue = (0.0 - math.log(part) / self.depth for part in self.colour)
        return red, green, blue


@dataclass(frozen=True)
class Relief:
    """A picture whose light parts stand out. Only light is turned by it; outlines stay.

    height  of white over black, scene units; below 0 dark parts stand out
    """

    texture: Texture
    height: float = 0.02

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise BadInputError(f"relief has height {self.height}; it must be finite")


@dataclass(frozen=True)
class Look:
    """A material; unless light goes through, the same on both sides of the surface.

    model       "diffuse" (chalk), "plastic" (a coloured body under a clear coat),
                "metal" (`colour` is what it reflects), "brushed" (metal, scratched in planes across `grain`),
                "satin" (a lustrous cloth-like sheen and a soft coat),
                "glass" (clear, refracts; `colour` is what one passage through its surface lets through),
                "smoke" (a cloud that fills the surface),
                "gouraud" (drawn, not lit: see `render.mitsuba.gouraud`), "bsdf" (a material of Mitsuba,
                `bsdf`)
    colour      linear Rec.709 reflectance
    roughness   of the coat or the metal: 0.03 is a mirror's gloss, 0.5 is matt
    sheen       of satin: how much lighter it is where it turns away, 0 … 1
    metallic    of satin: how much the highlight takes the colour, 0 … 1
    coat        of satin: how much of a clear coat lies on it, 0 … 1
    grain       of brushed metal: what scratches lie across, an axis of the undeformed subject
    refraction  of glass: its index, 1.5 for window glass and honey
    absorption  of glass: what it takes from light by the way inside, or none
    density     of smoke: how often light is scattered on its way through half of the subject's size
    colour_from name of a vertex attribute (V, 3) that replaces `colour`, or none
    pigment     a pattern that replaces `colour` and moves with the material, or none
    measure     a number that replaces `colour`, such as the speed, shown by a colour map, or none
    picture     one from a file that replaces `colour`, or none
    rough       a picture from a file that replaces `roughness`, or none
    relief      a picture from a file that dents and raises it, or none
    projection  how pictures lie on it
    bsdf        a material of Mitsuba that stands for all else, or none
    wireframe   how edges are drawn over it, or none
    """

    model: str
    colour: Triple
    roughness: float = 0.1
    sheen: float = 0.0
    metallic: float = 0.0
    coat: float = 0.4
    grain: Triple = (0.0, 1.0, 0.0)
    refraction: float = 1.5
    absorption: Absorption | None = None
    density: float = 2.0
    colour_from: str | None = None
    pigment: Pigment | None = None
    measure: Measure | None = None
    picture: Texture | None = None
    rough: Texture | None = None
    relief: Relief | None = None
    projection: Projection = field(default_factory=Projection)
    bsdf: Bsdf | None = None
    wireframe: Wireframe | None = None

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise BadInputError(f"look has model {self.model!r}; it can be {', '.join(MODELS)}")
        if not all(0.0 <= part <= 1.0 for part in self.colour):
            raise BadInputError(f"look has colour {self.colour}; reflectances lie between 0 and 1")
        for name in ("roughness", "sheen", "metallic", "coat"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"look has {name} {getattr(self, name)}; it must lie between 0 and 1")
        if not (1.0 < self.refraction <= 4.0 and 0.0 < self.density <= 1000.0):
            raise BadInputError(
                f"look has refraction {self.refraction} and density {self.density}; the first lies above 1 "
                "and up to 4, the second above 0 and up to 1000"
            )
        patterns = [name for name in COLOURED_BY if getattr(self, name) is not None]
        if self.model in PLAIN and patterns:
            raise BadInputError(f"a look of {self.model} has one colour; leave its {patterns[0]} out")
        if len(patterns) > 1:
            raise BadInputError(f"look has {' and '.join(patterns)}; its colour comes from one of them")
        if self.has_pictures and (self.pigment or self.measure):
            raise BadInputError(
                f"look has a {patterns[0]}, and pictures from files beside it; take one of the two"
            )
        if (self.model == "bsdf") != (self.bsdf is not None):
            raise BadInputError("a look of model bsdf has a bsdf, and no other has one")
        if self.rough and self.model not in ROUGH:
            raise BadInputError(f"a look of {self.model} has one roughness; those of {', '.join(ROUGH)} vary")
        if self.relief and self.model in (*CLEAR, "gouraud", "brushed"):
            raise BadInputError(f"a look of {self.model} takes no relief; leave it out")
        if self.absorption and self.model != "glass":
            raise BadInputError(f"a look of {self.model} does not heed absorption; only glass does")
        if math.hypot(*self.grain) < 1e-12:
            raise BadInputError("look has grain (0, 0, 0); an axis has a length")

    @property
    def is_clear(self) -> bool:
        """Whether light goes through."""
        return self.model in CLEAR or (self.bsdf is not None and self.bsdf.is_clear)

    @property
    def repeats(self) -> bool:
        """Whether its row of colours begins again after its end; otherwise the ends go on."""
        return self.pigment is not None and self.pigment.repeats

    @property
    def has_pictures(self) -> bool:
        """Whether pictures from files are laid on it, or may be."""
        return any(part is not None for part in (self.picture, self.rough, self.relief, self.bsdf))


_MARBLE = Pigment(
    "marble",
    ((0.80, 0.79, 0.77), (0.085, 0.09, 0.105), (0.36, 0.35, 0.34)),
    scale=0.9,
    axis=(0.35, 1.0, 0.2),
    softness=0.75,
    share=0.2,
    turbulence=1.05,
    octaves=5,
    seed=3,
)
_SWIRL = Pigment(
    "layers",
    ((0.80, 0.74, 0.66), (0.66, 0.07, 0.12), (0.80, 0.74, 0.66), (0.80, 0.36, 0.42)),
    scale=0.17,
    axis=(0.25, 1.0, 0.1),
    softness=0.1,
    turbulence=0.6,
    octaves=1,
    seed=5,
)
"""Both are made for a subject about 2 scene units across."""

LOOKS = {
    "clay": Look("diffuse", (0.73, 0.595, 0.46)),
    "putty": Look("satin", (0.44, 0.41, 0.36), roughness=0.62, sheen=0.25, coat=0.0),
    "glaze": Look("plastic", (0.38, 0.012, 0.008), roughness=0.055),
    "ceramic": Look("plastic", (0.34, 0.50, 0.43), roughness=0.04),
    "chrome": Look("metal", (0.80, 0.81, 0.82), roughness=0.04),
    "brushed": Look("brushed", (0.76, 0.74, 0.71), roughness=0.28),
    "taffy": Look("satin", (0.80, 0.26, 0.34), roughness=0.32, sheen=0.5, metallic=0.2),
    "swirl": Look("satin", (0.80, 0.74, 0.66), roughness=0.3, sheen=0.3, pigment=_SWIRL),
    "pearl": Look("satin", (0.80, 0.76, 0.74), roughness=0.26, sheen=0.4, metallic=0.45),
    "marble": Look("plastic", (0.80, 0.79, 0.77), roughness=0.13, pigment=_MARBLE),
    "cream": Look("plastic", (0.82, 0.71, 0.53), roughness=0.22),
    "coffee": Look("plastic", (0.045, 0.016, 0.006), roughness=0.07),
    "honey": Look("glass", (1.0, 0.8, 0.36), refraction=1.49, absorption=Absorption((0.96, 0.72, 0.3), 0.4)),
    "glass": Look("glass", (1.0, 1.0, 1.0), refraction=1.5, absorption=Absorption((0.80, 0.93, 0.89))),
    "smoke": Look("smoke", (0.95, 0.95, 0.96), density=1.6),
    "speed": Look("satin", (0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("speed")),
    "strain": Look("satin", (0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("stretch")),
    "symbolics_1990": Look("gouraud", (0.95, 0.30, 0.03), roughness=0.3),
}
