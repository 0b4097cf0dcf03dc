"""Parts of the entry `look`: patterns, measures, pictures from files, and how they are projected.

Colours are linear Rec.709.
"""

from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    HEX_PATTERN,
    ORIGIN,
    Axis,
    ByForm,
    Colour,
    Degrees,
    Document,
    OneOfSeveral,
    Positive,
    Real,
    SchemaKeywords,
    Triple,
    ZeroToOne,
    axis,
    is_written_number,
    one_of,
    optional,
    parsed_colour,
    require_three,
    vector,
)
from flowsculpt.pipeline.shot.documents.flow_documents import BARE
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.render.scene.materials import Absorption, Relief, Subsurface
from flowsculpt.render.scene.measured_colours import KINDS, Measure
from flowsculpt.render.scene.palettes import COLOUR_MAPS, REVERSED
from flowsculpt.render.scene.patterns import PATTERNS, Pigment
from flowsculpt.render.scene.surface import Wireframe
from flowsculpt.render.scene.texture_projection import PROJECTIONS, TextureProjection
from flowsculpt.render.scene.textures import Texture

_PROJECTIONS_WITH = {
    "axis": ("planar", "cylindrical", "spherical"),
    "centre": ("planar", "box", "cylindrical", "spherical"),
    "turn": ("planar", "box", "cylindrical", "spherical"),
    "scale": ("planar", "box", "cylindrical"),
    "repeats": ("cylindrical", "spherical"),
}
"""The projections that have a setting, where not all have it."""


Octaves = Annotated[int, Field(ge=1, le=8)]


class PatternDocument(Document):
    colours: Annotated[list[Colour], Field(min_length=2, max_length=16)] = Field(
        description="two or more, linear Rec.709 or '#c04020'"
    )
    scale: Positive = Field(1.0, description="size of the pattern (units)")
    axis: Axis = Field("y", description="the pattern's direction or axis: x, y, z or a vector")
    centre: Triple = Field(ORIGIN, description="origin of the pattern (units)")
    softness: ZeroToOne = Field(0.04, description="of the borders between colours")
    turbulence: Annotated[float, Field(ge=0, le=10)] = Field(0.0, description="strength of its noise")
    octaves: Octaves = Field(1, description="of its noise: 1 is smooth; with more, borders become rough")
    seed: Annotated[int, Field(ge=0, lt=2**32)] = Field(0, description="another one, another pattern")
    heights: Annotated[list[Real], Field(max_length=16)] = Field(
        default_factory=list, description="relief: the height of each colour (units); outlines stay"
    )
    roughness: Annotated[list[ZeroToOne], Field(max_length=16)] = Field(
        default_factory=list, description="of each colour, in place of the material's"
    )

    per_copy: bool = Field(False, description="each copy has one colour, that at its middle at rest")

    def build(self, pattern: str) -> Pigment:
        given: dict[str, Any] = self.model_dump(exclude={"colours", "axis", "centre"})
        for name in ("heights", "roughness"):
            given[name] = tuple(float(each) for each in given[name])
        colours = tuple(vector(colour) for colour in self.colours)
        return Pigment(pattern, colours, axis=axis(self.axis), centre=vector(self.centre), **given)


class MarbleDocument(PatternDocument):
    share: ZeroToOne = Field(0.15, description="fraction of the ground that the veins take")
    softness: ZeroToOne = Field(0.6, description="of the borders between colours")
    turbulence: Annotated[float, Field(ge=0, le=10)] = Field(0.9, description="strength of its noise")
    octaves: Octaves = Field(4, description="of its noise: how fine it is")


class SpecklesDocument(PatternDocument):
    share: ZeroToOne = Field(0.45, description="the radius of the largest speckle, in cells")
    octaves: Octaves = Field(4, description="of its noise: how fine it is")


class SpotsDocument(PatternDocument):
    share: ZeroToOne = Field(0.45, description="the radius of the largest spot, in cells")


class ChipsDocument(PatternDocument):
    share: ZeroToOne = Field(0.9, description="the fraction of cells that have a chip")
    gap: ZeroToOne = Field(0.08, description="least distance between chips, in cells")
    sizes: Annotated[int, Field(ge=1, le=4)] = Field(
        2, description="of chips: smaller and smaller ones lie in the gaps of larger ones"
    )


class PigmentDocument(OneOfSeveral):
    """A pattern, by its name."""

    example = "{layers: {colours: [[1, 1, 1], [0, 0, 0]]}}"
    noun, several = "a pigment", tuple(PATTERNS)

    layers: PatternDocument | None = optional("bands along an axis")
    gradient: PatternDocument | None = optional("from colour to colour along an axis")
    rings: PatternDocument | None = optional("bands about an axis")
    radial: PatternDocument | None = optional("shells about a point, one after the other")
    marble: MarbleDocument | None = optional("veins in a ground")
    speckles: SpecklesDocument | None = optional("dots in a ground, each with all colours")
    spots: SpotsDocument | None = optional("round spots in a ground, of one colour each")
    chips: ChipsDocument | None = optional("angular chips in a ground, of one colour each: terrazzo")
    palette: PatternDocument | None = optional("one colour by chance for each copy of a subject")

    def build(self) -> Pigment:
        (pattern,) = self.named
        return getattr(self, pattern).build(pattern)


Palette = Annotated[str, one_of(COLOUR_MAPS, "palette")]
PaletteColours = Annotated[list[Colour], Field(min_length=2, max_length=16)]
Share = Annotated[str, Field(pattern=r"^(100|\d{1,2}(\.\d+)?) ?%$")]
RangeEnd = Annotated[Real | Share, ByForm(lambda value: isinstance(value, str))]


class ScaleDocument(Document):
    """The palette of a measure, and the numbers at its ends."""

    colours: Annotated[Palette | PaletteColours, ByForm(lambda value: isinstance(value, list))] | None = (
        optional("the palette: viridis, thermal or another; or two or more colours of a palette")
    )
    range: Annotated[list[RangeEnd], Field(min_length=2, max_length=2)] | None = optional(
        "numbers at its two ends; of values also [2%, 98%], below which so many of all frames lie"
    )
    reverse: bool = Field(False, description="the palette runs backwards")
    log: bool | None = optional("equal steps of colour are factors")
    centre: Real | None = optional("the number in the middle of the palette: the range is made even about it")
    missing: Colour | None = optional("of values: the colour where there is none")

    def build(self, of: str) -> Measure:
        ends = self.range or (None, None)
        low, high = (None if isinstance(end, str) else end for end in ends)
        below, above = (float(end.rstrip("% ")) / 100.0 if isinstance(end, str) else None for end in ends)
        given: dict[str, Any] = {"shares": (below, above), "log": self.log, "centre": self.centre}
        given |= {"missing": vector(self.missing)} if self.missing else {}
        if isinstance(self.colours, list):
            given["own"] = tuple(map(vector, self.colours[:: -1 if self.reverse else 1]))
        elif self.colours or self.reverse:
            given["colours"] = (self.colours or KINDS[of].colours) + REVERSED * self.reverse
        return Measure(of, low=low, high=high, **given)


Scale = Annotated[ScaleDocument | None, BARE]


class MeasureDocument(OneOfSeveral):
    """A measured number, by its name."""

    example = "{speed: {range: [0, 2]}}"
    noun, several = "a measure", tuple(KINDS)

    speed: Scale = optional("of the flow at each point (units/s)")
    stretch: Scale = optional("largest factor by which a direction has lengthened since the rest")
    area: Scale = optional("factor by which the surface has grown since the rest")
    values: Scale = optional("what the subject measures, by its own `values`")

    def build(self) -> Measure:
        (of,) = self.named
        return getattr(self, of).build(of)


def _read_texture(name: str, space: str | None, info: ValidationInfo) -> Texture:
    """Return a picture that can be read, and note its digest. Raises a finding for others."""
    context = ParseContext.of(info)
    path = context.file(name)
    digest = context.digests[path]
    return context.attempt(lambda: Texture.of(str(path), digest, space))


def _texture(space: str | None) -> AfterValidator:
    """Return a validator that turns the name of a file into a texture."""
    return AfterValidator(lambda name, info: _read_texture(name, space, info))


class PictureDocument(Document):
    """A picture of colours, and its colour space."""

    file: str = Field(description="an EXR, PNG, JPEG or TIFF beside the shot file")
    space: str | None = optional(
        "srgb, linear, data, or a colour space of OpenColorIO; by default the file's own"
    )

    _texture: Texture = PrivateAttr()

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> Self:
        self._texture = _read_texture(self.file, self.space, info)
        return self

    def build(self) -> Texture:
        return self._texture


class ReliefDocument(Document):
    file: Annotated[str, _texture("data")] = Field(
        description="an EXR, PNG, JPEG or TIFF beside the shot file"
    )
    height: Real = Field(0.02, description="of white over black; below 0 dark parts stand out (units)")

    def build(self) -> Relief:
        texture: Any = self.file
        return Relief(texture, float(self.height))


def _colour_form(value: Any) -> int:
    """Return which member of `ColourOrPicture` a value is: names of pictures have a suffix."""
    if isinstance(value, dict):
        return 0 if {"r", "g", "b"} <= {str(name).lower() for name in value} else 2
    return int(isinstance(value, str) and "." in value)


ColourOrPicture = Annotated[Colour | Annotated[str, _texture(None)] | PictureDocument, ByForm(_colour_form)]
NumberOrPicture = Annotated[
    ZeroToOne | Annotated[str, _texture("data")],
    ByForm(lambda value: isinstance(value, str) and not is_written_number(value)),
]


class ProjectionDocument(Document):
    kind: Annotated[str, one_of(PROJECTIONS, "projection")] = Field(
        "box",
        description="planar, box, cylindrical, spherical, or model: the texture coordinates of the subject",
    )
    axis: Axis | None = optional(
        "a planar projection's direction, or the axis that others go around: x, y, z or a vector"
    )
    centre: Triple = Field(
        default_factory=lambda: [*ORIGIN], description="the picture's middle, or the axis (units)"
    )
    scale: Positive = Field(2.0, description="width of a picture, or height of a cylindrical one (units)")
    repeats: Annotated[int, Field(ge=1, le=1000)] = Field(1, description="pictures on the way around")
    turn: Degrees = Field(0.0, description="in its plane, anticlockwise, or about the axis (degrees)")
    offset: Annotated[list[Real], Field(min_length=2, max_length=2)] = Field(
        default_factory=lambda: [0.0, 0.0], description="to the right and up, as fractions of the picture"
    )

    @model_validator(mode="after")
    def _kind_has_all(self) -> Self:
        for name, kinds in _PROJECTIONS_WITH.items():
            if name in self.model_fields_set and self.kind not in kinds:
                raise finding(
                    f"projection has {name}, which {self.kind} does not use. Remove it, or take "
                    f"{' or '.join(kinds)}."
                )
        return self

    def build(self) -> TextureProjection:
        right, up = self.offset
        return TextureProjection(
            self.kind,
            None if self.axis is None else axis(self.axis),
            vector(self.centre),
            float(self.scale),
            self.repeats,
            self.turn * DEGREE,
            (float(right), float(up)),
        )


AbsorbedColour = Annotated[
    list[Annotated[float, Field(gt=0, le=1)]],
    Field(min_length=3, max_length=3),
    BeforeValidator(parsed_colour),
    SchemaKeywords(type=["array", "string"], pattern=HEX_PATTERN),
]


class AbsorptionDocument(Document):
    colour: AbsorbedColour = Field(
        description="of white light that has gone so far: red, green, blue up to 1, or '#c04020'"
    )
    depth: Annotated[float, Field(gt=0, le=1000)] = Field(
        1.0, description="that distance, in half-sizes of the subject"
    )

    def build(self) -> Absorption:
        return Absorption(vector(self.colour), float(self.depth))


Radius = Annotated[float, Field(ge=1e-4, le=100)]
RadiusTriple = Annotated[list[Radius], BeforeValidator(require_three), Field(min_length=3, max_length=3)]


class SubsurfaceDocument(Document):
    example = "{radius: 0.1}"

    radius: Annotated[Radius | RadiusTriple, ByForm(lambda value: isinstance(value, list))] = Field(
        description="mean distance that light goes before it is scattered, in half-sizes of the subject; a "
        "number, or one each for red, green and blue"
    )

    def build(self) -> Subsurface:
        radius = self.radius if isinstance(self.radius, list) else [self.radius] * 3
        return Subsurface(vector(radius))


class WireframeDocument(Document):
    example = "{width: 1}"

    colour: Colour | None = optional(
        "of the lines: red, green, blue from 0 to 1, linear Rec.709, or '#c04020'"
    )
    width: Annotated[float, Field(gt=0, le=100)] = Field(1.0, description="of the lines (pixels)")

    def build(self) -> Wireframe:
        colour = {} if self.colour is None else {"colour": vector(self.colour)}
        return Wireframe(width=float(self.width), **colour)
