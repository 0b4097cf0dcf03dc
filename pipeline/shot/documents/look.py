"""What a shot file says under `look`, and the look it becomes. Colours are linear Rec.709."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from pipeline.shot.documents.bsdf import bsdf_of, is_sound
from pipeline.shot.documents.fields import (
    Axis,
    Colour,
    Document,
    Told,
    axis,
    exactly_one,
    one_of,
    vector,
)
from pipeline.shot.documents.look_parts import (
    ColourOrPicture,
    MeasureDocument,
    PictureDocument,
    PigmentDocument,
    ProjectionDocument,
    ReliefDocument,
    Share,
    ShareOrPicture,
)
from pipeline.shot.yaml.parse_context import Surroundings, finding
from render.base.errors import RenderError
from render.scene.bsdf import BSDFS, Bsdf
from render.scene.look import CLEAR, LOOKS, PLAIN, Absorption, Look
from render.scene.textures import Texture
from render.scene.wireframe import Wireframe

Written = Annotated[dict[str, Any], Told(required=["type"], properties={"type": {"enum": list(BSDFS)}})]

_HEEDING = {
    "coat": "satin",
    "grain": "brushed",
    "refraction": "glass",
    "absorption": "glass",
    "density": "smoke",
}
"""The model that heeds a value, where no other does."""

_BUILT = ("absorption", "pigment", "measure", "relief", "projection")
"""Parts of a look that are documents of their own."""


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
    """A look of the registry with some of its values replaced, or a material of Mitsuba."""

    model_config = exactly_one("material", "bsdf")

    material: Annotated[str, one_of(LOOKS, "look")] | None = None
    bsdf: Written | None = None
    colour: ColourOrPicture | None = None
    roughness: ShareOrPicture | None = None
    sheen: Share | None = None
    metallic: Share | None = None
    coat: Share | None = None
    grain: Axis | None = None
    refraction: Annotated[float, Field(gt=1, le=4)] | None = None
    absorption: AbsorptionDocument | None = None
    density: Annotated[float, Field(gt=0, le=1000)] | None = None
    pigment: PigmentDocument | None = None
    measure: MeasureDocument | None = None
    relief: ReliefDocument | None = None
    projection: ProjectionDocument | None = None
    wireframe: WireframeDocument | None = None

    _bsdf: Bsdf | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _is_said(self, info: ValidationInfo) -> LookDocument:
        if (self.material is None) == (self.bsdf is None):
            fact = "neither material nor bsdf" if self.bsdf is None else "both material and bsdf"
            raise finding(f"look has {fact}; one of them says what it is made of. Write one.")
        if self.bsdf is None:
            return self._agrees()
        strangers = sorted(self.model_fields_set - {"bsdf", "projection", "wireframe"})
        if strangers:
            raise finding(f"look has {strangers[0]} beside bsdf, which says it itself. Remove one of them.")
        around = Surroundings.of(info)
        if is_sound(self.bsdf, around.folder):  # else it is told where it stands
            self._bsdf = bsdf_of(self.bsdf, around)
        return self

    def _agrees(self) -> LookDocument:
        assert self.material is not None
        model = LOOKS[self.material].model
        pattern = next((name for name in ("pigment", "measure", "picture") if self._has(name)), None)
        if pattern and model in PLAIN:
            raise PydanticCustomError(
                "pigment",
                "look has a {pattern}, and {why} {material}, which has one colour. Take one of {others}, "
                "or write colour.",
                {
                    "pattern": pattern,
                    "why": "light goes through" if model in CLEAR else "scratches make the pattern of",
                    "material": self.material,
                    "others": ", ".join(name for name, look in LOOKS.items() if look.model not in PLAIN),
                },
            )
        given = [name for name in ("colour", "pigment", "measure") if getattr(self, name)]
        if len(given) > 1:
            raise finding(
                f"look has both {given[0]} and {given[1]}; a {given[1]} has its own colours. Remove one of "
                "them."
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
        if self.projection and not (self.relief or self._has("picture") or self._has("rough")):
            raise finding(
                "look has a projection, and no picture for it to lay on. Name a file as colour, roughness or "
                "relief, or remove it."
            )
        try:
            self.build()
        except RenderError as error:
            raise finding(f"{error}.") from None
        return self

    def _has(self, what: str) -> bool:
        """Whether it says that; "picture" is a file as its colour, "rough" one as its roughness."""
        if what == "picture":
            return isinstance(self.colour, PictureDocument | Texture)
        return isinstance(self.roughness, Texture) if what == "rough" else getattr(self, what) is not None

    def build(self) -> Look:
        """A colour takes the place of the look's own pattern, and of what it absorbs."""
        if self.material is None:
            assert self._bsdf is not None, "what is wrong with it has been told"
            base = Look("bsdf", self._bsdf.colour, bsdf=self._bsdf)
        else:
            base = LOOKS[self.material]
        named = {"material", "bsdf", "colour", "roughness", "grain", "wireframe", *_BUILT}
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude=named)
        if self.colour or self.pigment or self.measure:
            given |= {"pigment": None, "measure": None}
        if self.colour:
            given |= {"absorption": None, **self._coloured()}
        if self.roughness is not None:
            given["rough" if self._has("rough") else "roughness"] = self.roughness
        if self.grain:
            given["grain"] = axis(self.grain)
        for name in (*_BUILT, "wireframe"):
            if (part := getattr(self, name)) is not None:
                given[name] = part.build()
        return dataclasses.replace(base, **given)

    def _coloured(self) -> dict[str, Any]:
        if isinstance(self.colour, list):
            return {"colour": vector(self.colour)}
        return {"picture": self.colour.build() if isinstance(self.colour, PictureDocument) else self.colour}
