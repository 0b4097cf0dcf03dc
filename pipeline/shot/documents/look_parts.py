"""What a shot file says under `pigment`: a pattern of colours, and its values. Colours are linear Rec.709."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.documents.fields import (
    DEGREE,
    Axis,
    Colour,
    Document,
    Positive,
    Real,
    Triple,
    axis,
    exactly_one,
    one_of,
    vector,
)
from pipeline.shot.yaml.parse_context import Surroundings, finding
from pipeline.shot.yaml.source import Source
from render.base.errors import RenderError
from render.scene.colour_maps import COLOUR_MAPS
from render.scene.look import LOOKS, Relief
from render.scene.measure import KINDS, Measure
from render.scene.patterns import PATTERNS, Pigment
from render.scene.texture_projection import PROJECTIONS, Projection
from render.scene.textures import Texture, read_picture

HERE = [0.0, 0.0, 0.0]
Share = Annotated[float, Field(ge=0, le=1)]
Colours = Annotated[list[Colour], Field(min_length=2, max_length=16)]


class PatternDocument(Document):
    """See `Pigment`."""

    colours: Colours
    scale: Positive = 1.0
    axis: Axis = "y"
    centre: Triple = HERE
    softness: Share = 0.04
    turbulence: Annotated[float, Field(ge=0, le=10)] = 0.0
    octaves: Annotated[int, Field(ge=1, le=8)] = 4
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    def build(self, pattern: str) -> Pigment:
        given = self.model_dump(exclude={"colours", "axis", "centre"})
        colours = tuple(vector(colour) for colour in self.colours)
        return Pigment(pattern, colours, axis=axis(self.axis), centre=vector(self.centre), **given)


class MarbleDocument(PatternDocument):
    """share: how much of the ground the veins take"""

    share: Share = 0.15
    softness: Share = 0.6
    turbulence: Annotated[float, Field(ge=0, le=10)] = 0.9
    octaves: Annotated[int, Field(ge=1, le=8)] = 4


class SpecklesDocument(PatternDocument):
    """share: the radius of the largest speckle, in cells"""

    share: Share = 0.45


class PigmentDocument(Document):
    """One pattern, by its name."""

    model_config = exactly_one(*PATTERNS)

    layers: PatternDocument | None = None
    gradient: PatternDocument | None = None
    rings: PatternDocument | None = None
    marble: MarbleDocument | None = None
    speckles: SpecklesDocument | None = None

    @model_validator(mode="after")
    def _is_one(self) -> PigmentDocument:
        if len(self.model_fields_set) != 1:
            raise PydanticCustomError(
                "pigment",
                "pigment names {count} patterns; it is one of {patterns}. Write one, such as "
                "pigment: {{layers: {{colours: [[1, 1, 1], [0, 0, 0]]}}}}.",
                {"count": len(self.model_fields_set), "patterns": ", ".join(PATTERNS)},
            )
        return self

    def build(self) -> Pigment:
        (pattern,) = self.model_fields_set
        built: Pigment = getattr(self, pattern).build(pattern)
        return built


_HEEDING = {
    "axis": ("planar", "cylindrical", "spherical"),
    "scale": ("planar", "box", "cylindrical"),
    "repeats": ("cylindrical", "spherical"),
}
"""The projections that heed a value, where not all do."""


class ScaleDocument(Document):
    """The colours of numbers, and what their ends stand for."""

    colours: Annotated[str, one_of(COLOUR_MAPS, "colour map")] | None = None
    range: Annotated[list[Real], Field(min_length=2, max_length=2)] | None = None

    def build(self, of: str) -> Measure:
        low, high = self.range or (None, None)
        return Measure(of, self.colours, low, high)


class MeasureDocument(Document):
    """What is measured, by its name."""

    model_config = exactly_one(*KINDS)

    speed: ScaleDocument | None = None
    stretch: ScaleDocument | None = None
    area: ScaleDocument | None = None

    @model_validator(mode="after")
    def _is_one(self) -> MeasureDocument:
        if len(self.model_fields_set) != 1:
            raise finding(
                f"measure names {len(self.model_fields_set)} things; it is one of {', '.join(KINDS)}. Write "
                "one, such as measure: {speed: {range: [0, 2]}}."
            )
        try:
            self.build()
        except RenderError as error:
            raise finding(f"{error}. Write another range.") from None
        return self

    def build(self) -> Measure:
        (of,) = self.model_fields_set
        scale: ScaleDocument | None = getattr(self, of)
        return (scale or ScaleDocument()).build(of)


def _texture(name: str, space: str | None, info: ValidationInfo) -> Texture:
    """A picture that can be read; its digest is noted. Raises a finding for one that cannot."""
    around = Surroundings.of(info)
    path = around.file(name)
    digest = around.digests[path]
    try:
        read_picture(str(path), digest, space)
    except RenderError as error:
        raise finding(str(error)) from None
    return Texture(digest, space, str(path))


def _colours(name: str, info: ValidationInfo) -> Any:
    return _texture(name, None, info)


def _numbers(name: str, info: ValidationInfo) -> Any:
    return _texture(name, "data", info)


class PictureDocument(Document):
    """A picture of colours, and what its pixels are."""

    file: str
    space: str | None = None

    _texture: Texture = PrivateAttr()

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> PictureDocument:
        self._texture = _texture(self.file, self.space, info)
        return self

    def build(self) -> Texture:
        return self._texture


class ReliefDocument(Document):
    """See `Relief`."""

    file: Annotated[str, AfterValidator(_numbers)]
    height: Real = 0.02

    def build(self) -> Relief:
        texture: Any = self.file
        return Relief(texture, float(self.height))


def _form(value: Any) -> str:
    if isinstance(value, str):
        return "by name"
    return "spelt out" if isinstance(value, dict) else "plain"


ColourOrPicture = Annotated[
    Annotated[Colour, Tag("plain")]
    | Annotated[str, AfterValidator(_colours), Tag("by name")]
    | Annotated[PictureDocument, Tag("spelt out")],
    Discriminator(_form),
]
ShareOrPicture = Annotated[
    Annotated[Share, Tag("plain")] | Annotated[str, AfterValidator(_numbers), Tag("by name")],
    Discriminator(lambda value: "by name" if isinstance(value, str) else "plain"),
]
"""Of the names of files validation makes textures."""


class ProjectionDocument(Document):
    """See `Projection`; angles in degrees."""

    kind: Annotated[str, one_of(PROJECTIONS, "projection")] = "box"
    axis: Axis | None = None
    centre: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    scale: Positive = 2.0
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    turn: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    offset: Annotated[list[Real], Field(min_length=2, max_length=2)] = Field(
        default_factory=lambda: [0.0, 0.0]
    )

    @model_validator(mode="after")
    def _has_what_it_says(self) -> ProjectionDocument:
        for name, kinds in _HEEDING.items():
            if name in self.model_fields_set and self.kind not in kinds:
                raise finding(
                    f"projection has {name}, which {self.kind} does not heed. Remove it, or take "
                    f"{' or '.join(kinds)}."
                )
        return self

    def build(self) -> Projection:
        right, up = self.offset
        return Projection(
            self.kind,
            None if self.axis is None else axis(self.axis),
            vector(self.centre),
            float(self.scale),
            self.repeats,
            self.turn * DEGREE,
            (float(right), float(up)),
        )


def measurable(source: Source) -> Iterator[Problem]:
    """Points of a cloud have a speed; what is stretched are triangles."""
    subject, look = source.get("subject"), source.get("look")
    if not (isinstance(subject, dict) and "cloud" in subject):
        return
    said = source.get("look", "measure")
    name = look.get("material") if isinstance(look, dict) else look
    own = LOOKS[name].measure if isinstance(name, str) and name in LOOKS else None
    of = next(iter(said), None) if isinstance(said, dict) else own.of if own else None
    if of in ("stretch", "area"):
        yield (
            ("look", "measure") if said else ("look",),
            f"look shows {of}, which triangles have, and a cloud has none. Take speed.",
        )
