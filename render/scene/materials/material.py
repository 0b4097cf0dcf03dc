"""The base classes of materials, and parts that several of them have."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.picture_file import Pixels
from flowsculpt.render.scene.surface import Surface, Wireframe
from flowsculpt.render.scene.surface_detail import DetailLayer
from flowsculpt.render.scene.texture_projection import MODEL, TextureProjection
from flowsculpt.render.scene.textures import REPEATED, WHOLE, Texture, continued, texels_at

M = TypeVar("M", bound="Material")
P = TypeVar("P", bound="PatternedMaterial")
Floats = NDArray[np.float64]

_REFUSALS = {
    "roughness_texture": "has one roughness; those of plastic, metal and satin vary",
    "relief": "takes no relief; leave it out",
    "pigment": "has one colour; leave its pigment out",
    "measure": "has one colour; leave its measure out",
    "subsurface": "scatters no light below its surface; clay, marble, cream, glass and honey can",
    "colour_texture": "has one colour; leave its picture out",
    "wear": "shows no wear; those of clay, plastic, metal and satin do",
}
"""Messages about a field that a model does not have."""


CLEAR_OPACITY = 0.3
"""Opacity of clear bodies in previews. Readers do not refract there; at 0 some would show nothing."""


class PreviewSurface(NamedTuple):
    """Inputs of a UsdPreviewSurface. `colour` is linear Rec.709; the others lie between 0 and 1.

    Roughness is the root of the width of GGX lobes, as UsdPreviewSurface and glTF have it.
    """

    colour: Colour
    roughness: float
    metallic: float = 0.0
    clearcoat: float = 0.0
    opacity: float = 1.0
    refraction: float = 1.5
    is_matt: bool = False


@dataclass(frozen=True)
class Material:
    """Base class of materials. Opaque ones look the same from both sides.

    colour     linear Rec.709 reflectance
    roughness  of highlights: 0.03 is the gloss of a mirror, 0.5 is matt
    wireframe  lines drawn along edges, or None
    model      the model's name, in headers and keys
    """

    is_lit: ClassVar[bool] = True
    """False if the material brings its own light and background."""

    is_of_model: ClassVar[bool] = False
    """True for the materials of a model's file, each on its own faces."""

    _min_path_depth: ClassVar[int] = 0
    _stage_colour: ClassVar[Triple | None] = None

    colour: Colour
    roughness: float = 0.1
    wireframe: Wireframe | None = field(default=None, kw_only=True)
    model: str = field(default="", init=False)

    def __post_init__(self) -> None:
        if not all(0.0 <= part <= 1.0 for part in self.colour):
            raise BadInputError(f"look has colour {self.colour}; reflectances lie between 0 and 1")
        self._require_fractions("roughness")

    @property
    def auxiliary_colour(self) -> Triple:
        """Colour of a clear material in the albedo AOV, which would be black without."""
        return self.colour

    @property
    def min_path_depth(self) -> int:
        """Vertices of a path through the material (with fewer, a body is black); 0 if opaque."""
        return self._min_path_depth

    @property
    def is_clear(self) -> bool:
        """True if light passes through."""
        return self.min_path_depth > 0

    @property
    def stage_colour(self) -> Triple | None:
        """Reflectance of floor and wall from which the material stands out, or None if any will do."""
        return self._stage_colour

    @property
    def pattern(self) -> Pigment | Measure | None:
        """The pattern that gives colours by a phase per vertex, or None."""
        return None

    @property
    def measures_speed(self) -> bool:
        """True if its colours are the speed of the surface."""
        return isinstance(self.pattern, Measure) and self.pattern.of == Surface.SPEED

    @property
    def follows_all_frames(self) -> bool:
        """True if its colours depend on the values of all frames."""
        return isinstance(self.pattern, Measure) and self.pattern.follows_all_frames

    @property
    def parts_by_number(self) -> tuple[Material, ...]:
        """The materials of a model by their numbers; of other looks, the look itself."""
        return (self,)

    def texture(self, name: str) -> Texture | None:
        """Return the texture of its colour, roughness, metallic or normal; None where it has none."""
        found: Texture | None = getattr(self, f"{name}_texture", None)
        return found

    @property
    def opacity(self) -> Opacity | None:
        """Where the surface has holes, or None."""
        return None

    def colour_pixels(self, with_factor: bool = True) -> Pixels:
        """Return the pixels (H, W, 3) of the texture of its colour; a white one where it has none."""
        return np.ones((1, 1, 3), np.float32)

    def phases(self, surface: Surface) -> Floats | None:
        """Return the phases (V,) of its pattern at vertices, or None for a material without one.

        Raises BadInputError where the surface lacks what the pattern needs.
        """
        if self.pattern is None:
            return None
        if isinstance(self.pattern, Measure):
            return self.pattern.phases(surface)
        return self.pattern.phases(self.pattern.places(surface))

    def vertex_colours(self, surface: Surface) -> Floats | None:
        """Return linear Rec.709 reflectances (V, 3) of vertices, or None for a material of one colour.

        They are for pictures without a path tracer, which looks up colours per sample. Raises BadInputError
        where the surface lacks what the colours need.
        """
        phases = self.phases(surface)
        return None if phases is None or self.pattern is None else self.pattern.colours_of(phases)

    def preview_surface(self) -> PreviewSurface:
        """Return the preview surface that is nearest to the material, for other programs."""
        return PreviewSurface(self.colour, 1.0)

    def openpbr(self) -> dict[str, float | Colour]:
        """Return inputs of OpenPBR 1.1 (Academy Software Foundation, 2024) without those at their defaults.

        Unlike a preview surface, OpenPBR refracts, absorbs, and scatters light below a surface and inside a
        body. `transmission_depth` and `subsurface_radius` are in halves of the subject's size. Roughness is
        the root of the width of GGX lobes.
        """
        surface = self.preview_surface()
        inputs: dict[str, float | Colour] = {
            "base_color": surface.colour,
            "base_metalness": surface.metallic,
            "specular_roughness": surface.roughness,
            "geometry_opacity": surface.opacity,
        }
        return inputs | {"specular_weight": 0.0} if surface.is_matt or not self.is_lit else inputs

    @property
    def texture_projection(self) -> TextureProjection | None:
        """Projection of the material's textures, or None for a material without textures."""
        return None

    @property
    def has_normal_map(self) -> bool:
        """True if a texture turns the normals of the surface."""
        return False

    @property
    def has_opacity(self) -> bool:
        """True if light passes through parts of the surface as if they were not there."""
        return False

    @property
    def shows_paint(self) -> bool:
        """True if the material shows what the subject has on its faces."""
        return self.texture_projection is not None and self.texture_projection.kind == MODEL

    @property
    def scratch_axes(self) -> NDArray[np.float64] | None:
        """Unit axes (2, 3) along scratches and across them, or None for a material without scratches."""
        return None

    def with_values(self: M, **values: Any) -> M:
        """Return the material with fields replaced. None for a field that its model lacks is left out.

        Raises BadInputError for another value of such a field, and for a value out of range.
        """
        names = {part.name for part in fields(self) if part.init}
        for name, value in values.items():
            if name not in names and value is not None:
                refusal = _REFUSALS.get(name, f"does not heed {name}; leave it out")
                raise BadInputError(f"look {refusal}")
        return replace(self, **{name: value for name, value in values.items() if name in names})

    def _require_fractions(self, *names: str) -> None:
        for name in names:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadInputError(f"look has {name} {getattr(self, name)}; it must lie between 0 and 1")


@dataclass(frozen=True)
class PatternedMaterial(Material):
    """Base class of materials whose colour may vary over the surface, by one of four sources.

    colour_from     name of a vertex attribute (V, 3), or None
    pigment         a procedural pattern, or None
    measure         a measured number shown by a colour map, or None
    colour_texture  a texture, or None
    projection      the projection of textures

    normal_texture  a tangent-space normal map, or None
    opacity         where the surface has holes, or None
    wear            layers of dust, scratches and the like, see `surface_detail.worn`
    """

    colour_from: str | None = field(default=None, kw_only=True)
    pigment: Pigment | None = field(default=None, kw_only=True)
    measure: Measure | None = field(default=None, kw_only=True)
    colour_texture: Texture | None = field(default=None, kw_only=True)
    projection: TextureProjection = field(default_factory=TextureProjection, kw_only=True)
    normal_texture: Texture | None = field(default=None, kw_only=True, metadata=OMIT_DEFAULT)
    opacity: Opacity | None = field(default=None, kw_only=True, metadata=OMIT_DEFAULT)
    wear: tuple[DetailLayer, ...] = field(default=(), kw_only=True, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        super().__post_init__()
        sources = {
            "pigment": self.pigment,
            "measure": self.measure,
            "picture": self.colour_texture,
            "colour_from": self.colour_from,
        }
        names = [name for name, source in sources.items() if source is not None]
        if len(names) > 1:
            raise BadInputError(f"look has {' and '.join(names)}; its colour comes from one of them")
        if self.pigment and self.pigment.roughness and not hasattr(self, "roughness_texture"):
            raise BadInputError(f"look has a pigment with roughness, and {self.model} has no highlights")
        if self.wear and getattr(self, "subsurface", None):
            raise BadInputError("look has wear, and subsurface beside it; use one of the two")
        if self.texture_projection and self.pattern:
            raise BadInputError(
                f"look has a {names[0]}, and pictures from files beside it; use one of the two"
            )

    @property
    def pattern(self) -> Pigment | Measure | None:
        """The pigment or the measure, or None."""
        return self.pigment or self.measure

    @property
    def has_normal_map(self) -> bool:
        return self.normal_texture is not None

    @property
    def texture_projection(self) -> TextureProjection | None:
        """Projection of the textures, or None if there are none."""
        names = ("colour_texture", "roughness_texture", "metallic_texture", "relief", "normal_texture")
        textures = [getattr(self, name, None) for name in names]
        return self.projection if any([*textures, self.opacity and self.opacity.texture]) else None

    @property
    def has_opacity(self) -> bool:
        return self.opacity is not None

    def on_model(self: P) -> P:
        """Return the material with its textures where the model's file puts them."""
        names = ("colour", "roughness", "metallic", "normal")
        held = [*map(self.texture, names), self.opacity and self.opacity.texture]
        keeps_place = not all(each.repeats for each in held if each)
        return replace(self, projection=TextureProjection(MODEL, keeps_place=keeps_place))

    def vertex_colours(self, surface: Surface) -> Floats | None:
        """Return the texels at vertices; a vertex with two texture coordinates takes one of them."""
        if self.colour_texture is None:
            return super().vertex_colours(surface)
        rest = surface.require_rest("look has a picture")
        points = np.repeat(np.arange(len(rest), dtype=np.int32)[:, None], 3, axis=1)
        faces = surface.faces if len(surface.faces) else points
        corners, _ = self.projection.coordinates(rest, faces, surface.paint)
        coordinates = np.zeros((len(rest), 2))
        coordinates[faces.reshape(-1)] = corners.reshape(-1, 2)
        pixels = self.colour_pixels()
        height, width = pixels.shape[:2]
        right, up = self.projection.offset
        across = coordinates[:, 0] + 0.5 - right
        down = 0.5 + up - coordinates[:, 1] * (width / height if self.projection.keeps_shape else 1.0)
        return texels_at(pixels, across, down, self.colour_texture.wrap).astype(np.float64)

    def preview_surface(self) -> PreviewSurface:
        surface = self._whole_surface()
        return surface if self.opacity is None else surface._replace(opacity=self.opacity.factor)

    def _whole_surface(self) -> PreviewSurface:
        """Return the preview surface where it has no holes."""
        return super().preview_surface()

    def colour_pixels(self, with_factor: bool = True) -> Pixels:
        """Return the pixels of the colour texture (H, W, 3), where it is cut out with those around the holes
        continued into them: lookups blend neighbours. Raises as `read_picture`."""
        if self.colour_texture is None:
            return super().colour_pixels()
        texture = self.colour_texture if with_factor else replace(self.colour_texture, factor=WHOLE)
        pixels = texture.pixels()
        if self.opacity is None or self.opacity.texture is None:
            return pixels
        known = self.opacity.texture.numbers() > 0.0
        return continued(pixels, known) if known.shape[:2] == pixels.shape[:2] else pixels


@dataclass(frozen=True)
class Opacity:
    """The fraction of a surface that is there. Light passes through the rest, as through holes.

    factor   of all of it, or on the texture
    texture  of numbers, or None
    cutoff   from which fraction on all is there, and below nothing; None for the fraction itself
    """

    factor: float = 1.0
    texture: Texture | None = None
    cutoff: float | None = None

    def fractions(self) -> Pixels:
        """Return fractions (H, W, 1), with a cutoff far below 0 or 1 and above. Raises as `read_picture`."""
        texture = self.texture
        values = np.ones((1, 1, 1), np.float32) if texture is None else np.clip(texture.numbers(), 0.0, 1.0)
        values = values * np.float32(self.factor)
        return values if self.cutoff is None else 1.0 + (values - np.float32(self.cutoff)) * _STEEP

    def fractions_at(self, across: NDArray[Any], up: NDArray[Any]) -> NDArray[Any]:
        """Return the fractions (…) at places in the texture, from its lower left corner, sides of 1."""
        wrap = REPEATED if self.texture is None else self.texture.wrap
        return texels_at(self.fractions(), across, 1.0 - up, wrap)[..., 0]


_STEEP = np.float32(1e6)


@dataclass(frozen=True)
class Relief:
    """A texture of heights. It changes shading only: outlines stay.

    height  of white over black, scene units; below 0 dark parts stand out
    """

    texture: Texture
    height: float = 0.02

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise BadInputError(f"relief has height {self.height}; it must be finite")


@dataclass(frozen=True)
class Absorption:
    """Absorption inside a body: light falls exponentially with distance (Beer and Lambert).

    colour  linear Rec.709: the fraction of light left after `depth`; above 0
    depth   in halves of the subject's size
    """

    colour: Colour
    depth: float = 1.0

    def __post_init__(self) -> None:
        if not (all(0.0 < part <= 1.0 for part in self.colour) and 0.0 < self.depth <= 1000.0):
            raise BadInputError(
                f"absorption has colour {self.colour} and depth {self.depth}; colours lie above 0 and "
                "up to 1, depths above 0 and up to 1000"
            )

    @property
    def rate(self) -> Triple:
        """Absorption coefficient, per half of the subject's size."""
        red, green, blue = (0.0 - math.log(part) / self.depth for part in self.colour)
        return red, green, blue


def of_parts(colour: Colour, function: Callable[[float], float]) -> Colour:
    """Return a colour whose parts are values of a function of the parts of another."""
    red, green, blue = map(function, colour)
    return red, green, blue


@dataclass(frozen=True)
class Subsurface:
    """Scattering below the surface.

    radius  mean distance that red, green and blue light goes between two scattering events, in halves of the
            subject's size
    """

    radius: Triple

    def __post_init__(self) -> None:
        if not all(1e-4 <= part <= 100.0 for part in self.radius):
            raise BadInputError(
                f"subsurface has radius {self.radius}; each number lies between 0.0001 and 100"
            )

    def openpbr(self, colour: Colour) -> dict[str, float | Colour]:
        """Return the inputs of OpenPBR for an opaque body of a colour."""
        longest = max(self.radius)
        return {
            "subsurface_weight": 1.0,
            "subsurface_color": colour,
            "subsurface_radius": longest,
            "subsurface_radius_scale": of_parts(self.radius, lambda part: part / longest),
        }
