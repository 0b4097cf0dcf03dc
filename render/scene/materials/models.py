"""The material models: one dataclass each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple
from flowsculpt.render.scene.materials.material import (
    CLEAR_OPACITY,
    Absorption,
    Floats,
    Material,
    PatternedMaterial,
    PreviewSurface,
    Relief,
    Subsurface,
    of_parts,
)
from flowsculpt.render.scene.materials.mitsuba_bsdf import Bsdf
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.texture_projection import MODEL, TextureProjection
from flowsculpt.render.scene.textures import Texture

_DIM, _DARK = (0.12, 0.12, 0.123), (0.035, 0.037, 0.042)
"""Reflectances of stages: a mirror of a pale floor is as pale, and so is smoke before a pale wall. In a dim
one, lights stand out as reflections."""

_POLISHED = 1e-3
"""Roughness up to which glass refracts like a perfectly smooth surface."""

_COAT = {"coat_ior": 1.5, "coat_roughness": 0.16, "coat_darkening": 0.0}
_COAT_WEIGHT, _SHEEN_TINT = 0.25, 0.5
"""The clear coat and the sheen of the principled BSDF that draws satin (Burley 2012, section 5.3)."""


@dataclass(frozen=True)
class Diffuse(PatternedMaterial):
    """Chalk: reflects equally in all directions.

    relief      a texture of heights, or None
    subsurface  scattering below the surface, or None
    """

    relief: Relief | None = field(default=None, kw_only=True)
    subsurface: Subsurface | None = field(default=None, kw_only=True)
    model: str = field(default="diffuse", init=False)

    def _whole_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, 1.0, is_matt=True)

    def openpbr(self) -> dict[str, float | Colour]:
        below = {} if self.subsurface is None else self.subsurface.openpbr(self.colour)
        return super().openpbr() | below


@dataclass(frozen=True)
class Glossy(PatternedMaterial):
    """Base class of materials with highlights, whose roughness may vary.

    roughness_texture  a texture that replaces `roughness`, or None
    relief             a texture of heights, or None
    """

    roughness_texture: Texture | None = field(default=None, kw_only=True)
    relief: Relief | None = field(default=None, kw_only=True)

    @property
    def has_varied_roughness(self) -> bool:
        """True if a texture or a pigment gives the roughness."""
        has_pattern = bool(self.pigment and self.pigment.roughness)
        return (
            self.roughness_texture is not None or has_pattern or any(layer.roughness for layer in self.wear)
        )

    def _whole_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, math.sqrt(self.roughness))


@dataclass(frozen=True)
class Plastic(Glossy):
    """A coloured body under a clear coat.

    subsurface  scattering below the surface, or None
    """

    subsurface: Subsurface | None = field(default=None, kw_only=True)
    model: str = field(default="plastic", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.subsurface and self.has_varied_roughness:
            raise BadInputError(
                "look has subsurface and a picture or pattern of roughness; remove one, or give roughness as "
                "a number"
            )

    def openpbr(self) -> dict[str, float | Colour]:
        below = {} if self.subsurface is None else self.subsurface.openpbr(self.colour)
        return super().openpbr() | below


@dataclass(frozen=True)
class Metal(Glossy):
    """A metal that reflects `colour`."""

    _stage_colour: ClassVar = _DIM

    model: str = field(default="metal", init=False)

    def _whole_surface(self) -> PreviewSurface:
        return super()._whole_surface()._replace(metallic=1.0)


@dataclass(frozen=True)
class Satin(Glossy):
    """A lustrous, cloth-like surface with a soft coat.

    sheen     brightening where the surface turns away, 0 … 1
    metallic  how much the highlight takes the colour, 0 … 1
    coat      strength of the clear coat, 0 … 1

    metallic_texture  a texture that replaces `metallic`, or None
    """

    sheen: float = field(default=0.0, kw_only=True)
    metallic: float = field(default=0.0, kw_only=True)
    coat: float = field(default=0.4, kw_only=True)
    metallic_texture: Texture | None = field(default=None, kw_only=True, metadata=OMIT_DEFAULT)
    model: str = field(default="satin", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_fractions("sheen", "metallic", "coat")

    def _whole_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, self.roughness, self.metallic, self.coat)

    def openpbr(self) -> dict[str, float | Colour]:
        brightest = max(*self.colour, 1e-9)
        layers = {"coat_weight": _COAT_WEIGHT * self.coat, "fuzz_weight": self.sheen} | _COAT
        hue = of_parts(self.colour, lambda part: 1.0 - _SHEEN_TINT + _SHEEN_TINT * part / brightest)
        return super().openpbr() | layers | {"fuzz_color": hue}


@dataclass(frozen=True)
class BrushedMetal(Material):
    """A metal with scratches in planes across an axis.

    grain  the axis, in rest positions
    """

    _stage_colour: ClassVar = _DIM

    grain: Triple = field(default=(0.0, 1.0, 0.0), kw_only=True)
    model: str = field(default="brushed", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.hypot(*self.grain) < 1e-12:
            raise BadInputError("look has grain (0, 0, 0); an axis must not be zero")

    @property
    def scratch_axes(self) -> NDArray[np.float64]:
        """Axes (2, 3): some direction along the scratches, and the unit grain."""
        grain = np.array(self.grain) / math.hypot(*self.grain)
        other = np.eye(3)[int(np.abs(grain).argmin())]
        return np.stack([np.cross(grain, other), grain])

    def preview_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, math.sqrt(self.roughness), metallic=1.0)


@dataclass(frozen=True)
class Glass(Material):
    """A clear body that refracts light. `colour` is transmitted at each passage through the surface.

    roughness   of its surface: 0 is polished, 0.3 is frosted
    refraction  index of refraction, 1.5 for window glass and honey
    absorption  absorption inside the body, or None
    subsurface  scattering inside the body, or None
    """

    _min_path_depth: ClassVar = 10  # through several layers of glass

    roughness: float = 0.0
    refraction: float = field(default=1.5, kw_only=True)
    absorption: Absorption | None = field(default=None, kw_only=True)
    subsurface: Subsurface | None = field(default=None, kw_only=True)
    model: str = field(default="glass", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1.0 < self.refraction <= 4.0:
            raise BadInputError(f"look has refraction {self.refraction}; it lies above 1 and up to 4")

    @property
    def is_rough(self) -> bool:
        """True if the surface scatters light."""
        return self.roughness > _POLISHED

    @property
    def auxiliary_colour(self) -> Triple:
        """The colour after absorption over its `depth`."""
        left = self.absorption.colour if self.absorption else (1.0, 1.0, 1.0)
        red, green, blue = (part * share for part, share in zip(self.colour, left, strict=True))
        return red, green, blue

    def preview_surface(self) -> PreviewSurface:
        colour, roughness = self.auxiliary_colour, math.sqrt(self.roughness)
        return PreviewSurface(colour, roughness, opacity=CLEAR_OPACITY, refraction=self.refraction)

    def openpbr(self) -> dict[str, float | Colour]:
        """Return the inputs of a clear body.

        OpenPBR colours either its surface or its inside. Where there is a medium, the colours of the two
        passages through the surface become absorption along the subject's size, which is two halves.
        """
        inputs: dict[str, float | Colour] = {
            "base_color": self.auxiliary_colour,
            "specular_roughness": math.sqrt(self.roughness),
            "specular_ior": self.refraction,
            "transmission_weight": 1.0,
        }
        if self.absorption is None and self.subsurface is None:
            return inputs | {"transmission_color": self.colour}
        absorbed = self.absorption.rate if self.absorption is not None else (0.0, 0.0, 0.0)
        surface = of_parts(self.colour, lambda part: -math.log(max(part, 1e-6)))
        scattered = (0.0, 0.0, 0.0)
        depth = self.absorption.depth if self.absorption is not None else 1.0
        if self.subsurface is not None:
            scattered = of_parts(self.subsurface.radius, lambda part: 1.0 / part)
            depth = min(self.subsurface.radius)  # so that no part of `transmission_scatter` is above 1
        lost = [sum(parts) for parts in zip(absorbed, surface, scattered, strict=True)]
        red, green, blue = (math.exp(-rate * depth) for rate in lost)
        inputs |= {"transmission_color": (red, green, blue), "transmission_depth": depth}
        if self.subsurface is not None:
            inputs["transmission_scatter"] = of_parts(scattered, lambda part: part * depth)
        return inputs


@dataclass(frozen=True)
class Smoke(Material):
    """A cloud that fills the surface and scatters light.

    density  mean number of scattering events over half the subject's size
    """

    _min_path_depth: ClassVar = 16  # scatters several times
    _stage_colour: ClassVar = _DARK

    density: float = field(default=2.0, kw_only=True)
    model: str = field(default="smoke", init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.density <= 1000.0:
            raise BadInputError(f"look has density {self.density}; it lies above 0 and up to 1000")

    def preview_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, 1.0, opacity=CLEAR_OPACITY, is_matt=True)

    def openpbr(self) -> dict[str, float | Colour]:
        """Return the inputs of a cloud: a body whose surface neither reflects nor refracts."""
        left = math.exp(-1.0)  # of light that went one mean distance between two scattering events
        return {
            "base_color": self.colour,
            "specular_weight": 0.0,
            "specular_ior": 1.0,
            "specular_roughness": 0.0,
            "transmission_weight": 1.0,
            "transmission_color": (left, left, left),
            "transmission_depth": 1.0 / self.density,
            "transmission_scatter": self.colour,
        }


@dataclass(frozen=True)
class Painted(Material):
    """The materials of a model's file, each on its own faces.

    parts  by their numbers; without any, the material is matt and has one colour
    """

    is_of_model: ClassVar = True

    parts: tuple[PatternedMaterial, ...] = field(default=(), kw_only=True)
    model: str = field(default="painted", init=False)

    @property
    def texture_projection(self) -> TextureProjection | None:
        keeps_place = any(part.projection.keeps_place for part in self.parts)
        return TextureProjection(MODEL, keeps_place=keeps_place) if self.parts else None

    @property
    def has_normal_map(self) -> bool:
        return any(part.has_normal_map for part in self.parts)

    @property
    def has_opacity(self) -> bool:
        return any(part.has_opacity for part in self.parts)

    def with_values(self, **values: Any) -> Painted:
        """Return the look with a wireframe. Raises BadInputError for other values."""
        for name in values.keys() - {"wireframe"}:
            raise BadInputError(f"look model has the {name} of the model's file; leave {name} out")
        return replace(self, **values)

    @property
    def parts_by_number(self) -> tuple[Material, ...]:
        return self.parts or (self,)

    def texture(self, name: str) -> Texture | None:
        return self.parts[0].texture(name) if len(self.parts) == 1 else None

    def vertex_colours(self, surface: Surface) -> Floats | None:
        """Return the colours of the materials at vertices; one with several takes that of some face."""
        colours, paint = np.empty((len(surface.vertices), 3)), surface.paint
        if paint is None:
            return None
        for number, part in enumerate(self.parts):
            which = paint.materials == number
            if not which.any():
                continue
            faces, own = surface.faces[which], paint.of_faces(which)
            if part.colour_texture is not None:
                texels = part.vertex_colours(replace(surface, faces=faces, paint=own))
                assert texels is not None, "it has a texture"
                colours[faces] = texels[faces]
            else:
                dyed = own.colours is not None and part.colour_from == PaintedFaces.COLOURS
                colours[faces] = own.colours if dyed else part.colour
        return colours

    def preview_surface(self) -> PreviewSurface:
        return self.parts[0].preview_surface() if len(self.parts) == 1 else super().preview_surface()

    def openpbr(self) -> dict[str, float | Colour]:
        return self.parts[0].openpbr() if len(self.parts) == 1 else super().openpbr()


@dataclass(frozen=True)
class Gouraud(PatternedMaterial):
    """A surface drawn as in 1990, by vertex colours, without light transport (`scene.shaded_colours`)."""

    is_lit: ClassVar[bool] = False

    model: str = field(default="gouraud", init=False)


@dataclass(frozen=True)
class MitsubaMaterial(Material):
    """A material written out for Mitsuba. `colour` is about its reflectance, for quick previews.

    bsdf        its description
    projection  the projection of its textures
    """

    bsdf: Bsdf = field(kw_only=True)
    projection: TextureProjection = field(default_factory=TextureProjection, kw_only=True)
    model: str = field(default="bsdf", init=False)

    @classmethod
    def of(cls, bsdf: Bsdf) -> MitsubaMaterial:
        """Return the material of a description."""
        return cls(bsdf.colour, bsdf=bsdf)

    @property
    def min_path_depth(self) -> int:
        return 10 if self.bsdf.is_clear else 0

    @property
    def stage_colour(self) -> Triple | None:
        return _DIM if self.bsdf.is_metal else None

    @property
    def texture_projection(self) -> TextureProjection:
        return self.projection

    def preview_surface(self) -> PreviewSurface:
        return PreviewSurface(self.colour, self.roughness)


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
"""Both suit a subject about 2 scene units across."""

LOOKS: dict[str, Material] = {
    "clay": Diffuse((0.73, 0.595, 0.46)),
    "putty": Satin((0.44, 0.41, 0.36), roughness=0.62, sheen=0.25, coat=0.0),
    "glaze": Plastic((0.38, 0.012, 0.008), roughness=0.055),
    "ceramic": Plastic((0.34, 0.50, 0.43), roughness=0.04),
    "chrome": Metal((0.80, 0.81, 0.82), roughness=0.04),
    "brushed": BrushedMetal((0.76, 0.74, 0.71), roughness=0.28),
    "taffy": Satin((0.80, 0.26, 0.34), roughness=0.32, sheen=0.5, metallic=0.2),
    "swirl": Satin((0.80, 0.74, 0.66), roughness=0.3, sheen=0.3, pigment=_SWIRL),
    "pearl": Satin((0.80, 0.76, 0.74), roughness=0.26, sheen=0.4, metallic=0.45),
    "marble": Plastic((0.80, 0.79, 0.77), roughness=0.13, pigment=_MARBLE),
    "cream": Plastic((0.82, 0.71, 0.53), roughness=0.22),
    "coffee": Plastic((0.045, 0.016, 0.006), roughness=0.07),
    "honey": Glass((1.0, 0.8, 0.36), refraction=1.49, absorption=Absorption((0.96, 0.72, 0.3), 0.4)),
    "glass": Glass((1.0, 1.0, 1.0), refraction=1.5, absorption=Absorption((0.80, 0.93, 0.89))),
    "frosted": Glass((1.0, 1.0, 1.0), roughness=0.28, absorption=Absorption((0.84, 0.94, 0.91))),
    "smoke": Smoke((0.95, 0.95, 0.96), density=1.6),
    "speed": Satin((0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("speed")),
    "strain": Satin((0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("stretch")),
    "model": Painted((0.6, 0.6, 0.6), roughness=0.5),
    "symbolics_1990": Gouraud((0.95, 0.30, 0.03), roughness=0.3),
}
"""The looks that every shot can name, by their names."""
