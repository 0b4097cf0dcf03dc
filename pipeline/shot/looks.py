"""What a shot file says under `look`, and the look it becomes. Colours are linear Rec.709."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from pipeline.shot.fields import Axis, Colour, Document, Positive, Triple, axis, exactly_one, one_of, vector
from render.look import CLEAR, LOOKS, PLAIN, Absorption, Look
from render.pigment import PATTERNS, Pigment
from render.wireframe import Wireframe

HERE = [0.0, 0.0, 0.0]
Share = Annotated[float, Field(ge=0, le=1)]
Colours = Annotated[list[Colour], Field(min_length=2, max_length=16)]

_HEEDING = {
    "coat": "satin",
    "grain": "brushed",
    "refraction": "glass",
    "absorption": "glass",
    "density": "smoke",
}
"""The model that heeds a value, where no other does."""


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


class AbsorptionDocument(Document):
    """See `Absorption`."""

    colour: Annotated[list[Annotated[float, Field(gt=0, le=1)]], Field(min_length=3, max_length=3)]
    depth: Annotated[float, Field(gt=0, le=1000)] = 1.0

    def build(self) -> Absorption:
        return Absorption(vector(self.colour), float(self.depth))


class WireframeDocument(Document):
    """See `Wireframe`."""

    colour: Colour | None = None
    width: Annotated[float, Field(gt=0, le=100)] = 1.0

    def build(self) -> Wireframe:
        colour = {} if self.colour is None else {"colour": vector(self.colour)}
        return Wireframe(width=float(self.width), **colour)


class LookDocument(Document):
    """A look of the registry with some of its values replaced."""

    material: Annotated[str, one_of(LOOKS, "look")]
    colour: Colour | None = None
    roughness: Share | None = None
    sheen: Share | None = None
    metallic: Share | None = None
    coat: Share | None = None
    grain: Axis | None = None
    refraction: Annotated[float, Field(gt=1, le=4)] | None = None
    absorption: AbsorptionDocument | None = None
    density: Annotated[float, Field(gt=0, le=1000)] | None = None
    pigment: PigmentDocument | None = None
    wireframe: WireframeDocument | None = None

    @model_validator(mode="after")
    def _agrees(self) -> LookDocument:
        model = LOOKS[self.material].model
        if self.pigment and model in PLAIN:
            raise PydanticCustomError(
                "pigment",
                "look has a pigment, and {why} {material}, which has one colour. Take one of {others}, "
                "or write colour.",
                {
                    "why": "light goes through" if model in CLEAR else "scratches make the pattern of",
                    "material": self.material,
                    "others": ", ".join(name for name, look in LOOKS.items() if look.model not in PLAIN),
                },
            )
        if self.pigment and self.colour:
            raise PydanticCustomError(
                "pigment",
                "look has both colour and pigment; a pigment has its own colours. Remove one of them.",
            )
        for name, heeding in _HEEDING.items():
            if getattr(self, name) is not None and model != heeding:
                raise PydanticCustomError(
                    "facet",
                    "look has {name}, which {material} does not heed. Remove it, or take {fitting}.",
                    {
                        "name": name,
                        "material": self.material,
                        "fitting": " or ".join(n for n, look in LOOKS.items() if look.model == heeding),
                    },
                )
        return self

    def build(self) -> Look:
        """A colour takes the place of the look's own pattern, and of what it absorbs."""
        named = {"material", "colour", "grain", "absorption", "pigment", "wireframe"}
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude=named)
        if self.colour:
            given |= {"colour": vector(self.colour), "pigment": None, "absorption": None}
        if self.grain:
            given["grain"] = axis(self.grain)
        if self.absorption:
            given["absorption"] = self.absorption.build()
        if self.pigment:
            given["pigment"] = self.pigment.build()
        if self.wireframe:
            given["wireframe"] = self.wireframe.build()
        return dataclasses.replace(LOOKS[self.material], **given)
