"""What a shot file says under `pigment`: a pattern of colours, and its values. Colours are linear Rec.709."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from pipeline.shot.documents.fields import Axis, Colour, Document, Positive, Triple, axis, exactly_one, vector
from render.scene.patterns import PATTERNS, Pigment

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
