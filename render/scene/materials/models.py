"""The material models: one dataclass each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.materials.material import Absorption, Material, PatternedMaterial, Relief
from render.scene.materials.mitsuba_bsdf import Bsdf
from render.scene.texture_projection import Projection
from render.scene.textures import Texture


@dataclass(frozen=True)
class Diffuse(PatternedMaterial):
    """Chalk: reflects equally in all directions.

    relief  a texture of heights, or None
    """

    has_coat: ClassVar[bool] = False

    relief: Relief | None = field(default=None, kw_only=True)
    model: str = field(default="diffuse", init=False)

    @property
    def has_textures(self) -> bool:
        """True if a texture gives colour or relief."""
        return super().has_textures or self.relief is not None


@dataclass(frozen=True)
class Glossy(PatternedMaterial):
    """Base class of materials with highlights, whose roughness may vary.

    roughness_texture  a texture that replaces `roughness`, or None
    relief             a texture of heights, or None
    """

    roughness_texture: Texture | None = field(default=None, kw_only=True)
    relief: Relief | None = field(default=None, kw_only=True)

    @property
    def has_textures(self) -> bool:
        """True if a texture gives colour, roughness or relief."""
        return super().has_textures or self.roughness_texture is not None or self.relief is not None


@dataclass(frozen=True)
class Plastic(Glossy):
    """A coloured body under a clear coat."""

    model: str = field(default="plastic", init=False)


@dataclass(frozen=True)
class Metal(Glossy):
    """A metal that reflects `colour`."""

    has_body: ClassVar[bool] = False

    model: str = field(default="metal", init=False)


@dataclass(frozen=True)
class Satin(Glossy):
    """A lustrous, cloth-like surface with a soft coat.

    sheen     brightening where the surface turns away, 0 … 1
    metallic  how much the highlight takes the colour, 0 … 1
    coat      strength of the clear coat, 0 … 1
    """

    sheen: float = field(default=0.0, kw_only=True)
    metallic: float = field(default=0.0, kw_only=True)
    coat: float = field(default=0.4, kw_only=True)
    model: str = field(default="satin", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_fractions("sheen", "metallic", "coat")


@dataclass(frozen=True)
class BrushedMetal(Material):
    """A metal with scratches in planes across an axis.

    grain  the axis, in rest positions
    """

    has_body: ClassVar[bool] = False

    grain: Triple = field(default=(0.0, 1.0, 0.0), kw_only=True)
    model: str = field(default="brushed", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.hypot(*self.grain) < 1e-12:
            raise BadInputError("look has grain (0, 0, 0); an axis has a length")

    @property
    def scratch_axes(self) -> NDArray[np.float64]:
        """Axes (2, 3): some direction along the scratches, and the unit grain."""
        grain = np.array(self.grain) / math.hypot(*self.grain)
        other = np.eye(3)[int(np.abs(grain).argmin())]
        return np.stack([np.cross(grain, other), grain])


@dataclass(frozen=True)
class Glass(Material):
    """A clear body that refracts light. `colour` is transmitted at each passage through the surface.

    refraction  index of refraction, 1.5 for window glass and honey
    absorption  absorption inside the body, or None
    """

    refraction: float = field(default=1.5, kw_only=True)
    absorption: Absorption | None = field(default=None, kw_only=True)
    model: str = field(default="glass", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1.0 < self.refraction <= 4.0:
            raise BadInputError(f"look has refraction {self.refraction}; it lies above 1 and up to 4")

    @property
    def is_clear(self) -> bool:
        """Light passes through."""
        return True

    @property
    def auxiliary_colour(self) -> Triple:
        """The colour after absorption over its `depth`."""
        left = self.absorption.colour if self.absorption else (1.0, 1.0, 1.0)
        red, green, blue = (part * share for part, share in zip(self.colour, left, strict=True))
        return red, green, blue

    @property
    def min_path_depth(self) -> int:
        """Vertices of a path through several layers of glass."""
        return 10


@dataclass(frozen=True)
class Smoke(Material):
    """A cloud that fills the surface and scatters light.

    density  mean number of scattering events over half the subject's size
    """

    has_coat: ClassVar[bool] = False

    density: float = field(default=2.0, kw_only=True)
    model: str = field(default="smoke", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.density <= 1000.0:
            raise BadInputError(f"look has density {self.density}; it lies above 0 and up to 1000")

    @property
    def is_clear(self) -> bool:
        """Light passes through."""
        return True

    @property
    def min_path_depth(self) -> int:
        """Vertices of a path that scatters several times."""
        return 16


@dataclass(frozen=True)
class Gouraud(PatternedMaterial):
    """A surface drawn as in 1990, by vertex colours, without light transport: see
    `render.mitsuba.gouraud`."""

    is_lit: ClassVar[bool] = False

    model: str = field(default="gouraud", init=False)


@dataclass(frozen=True)
class MitsubaMaterial(Material):
    """A material written out for Mitsuba. `colour` is about its reflectance, for quick previews.

    bsdf        its description
    projection  the projection of its textures
    """

    bsdf: Bsdf = field(kw_only=True)
    projection: Projection = field(default_factory=Projection, kw_only=True)
    model: str = field(default="bsdf", init=False)

    @classmethod
    def of(cls, bsdf: Bsdf) -> MitsubaMaterial:
        """Return the material of a description."""
        return cls(bsdf.colour, bsdf=bsdf)

    @property
    def is_clear(self) -> bool:
        """True if light passes through some of it."""
        return self.bsdf.is_clear

    @property
    def min_path_depth(self) -> int:
        """Vertices of a path through glass, if it is clear."""
        return 10 if self.is_clear else 0

    @property
    def texture_projection(self) -> Projection:
        """Projection of the textures that the description may have."""
        return self.projection


AnyMaterial = Diffuse | Plastic | Metal | Satin | BrushedMetal | Glass | Smoke | Gouraud | MitsubaMaterial
"""The models, for `from_plain`."""
