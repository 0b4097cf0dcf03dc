"""The entry `look` of a shot file, and the look it becomes. Colours are linear Rec.709."""

from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from pipeline.shot.documents.bsdf import bsdf_of, is_valid
from pipeline.shot.documents.colours import no_bare_colour
from pipeline.shot.documents.fields import (
    MAPPING_IS_SECOND,
    Axis,
    Document,
    SchemaKeywords,
    ZeroToOne,
    axis,
    exactly_one,
    one_of,
    optional,
    vector,
)
from pipeline.shot.documents.look_parts import (
    AbsorptionDocument,
    ColourOrPicture,
    MeasureDocument,
    NumberOrPicture,
    PictureDocument,
    PigmentDocument,
    ProjectionDocument,
    ReliefDocument,
    SubsurfaceDocument,
    WireframeDocument,
)
from pipeline.shot.yaml.plain_text import listed
from pipeline.shot.yaml.validation import ParseContext, finding
from render.base.errors import RenderError
from render.scene.materials import LOOKS, Material, MitsubaMaterial, PatternedMaterial
from render.scene.materials.mitsuba_bsdf import BSDFS, Bsdf
from render.scene.textures import Texture

BsdfMapping = Annotated[
    dict[str, Any], SchemaKeywords(required=["type"], properties={"type": {"enum": list(BSDFS)}})
]

_MODEL_WITH = {
    "sheen": "satin",
    "metallic": "satin",
    "coat": "satin",
    "grain": "brushed",
    "refraction": "glass",
    "absorption": "glass",
    "density": "smoke",
}
"""The only model that has a setting."""

_PARTS = ("absorption", "subsurface", "pigment", "measure", "relief", "projection")
"""Settings of a look that are documents of their own."""


class LookDocument(Document):
    """A look of the registry with some of its values replaced, or a material of Mitsuba."""

    example = "{material: clay}"

    model_config = exactly_one("material", "bsdf")

    material: Annotated[str, one_of(LOOKS, "look")] | None = optional("the look to begin with")
    bsdf: BsdfMapping | None = optional("in its place a material of Mitsuba, by the names of its manual")
    colour: ColourOrPicture | None = optional(
        "red, green, blue from 0 to 1, linear Rec.709; '#c04020', sRGB; or a picture beside the shot file"
    )
    roughness: NumberOrPicture | None = optional(
        "0.03 is a mirror's gloss, 0.5 is matt; or a picture beside the shot file"
    )
    sheen: ZeroToOne | None = optional("of satin: how much lighter grazing angles are")
    metallic: ZeroToOne | None = optional("of satin: how much the highlight takes the colour")
    coat: ZeroToOne | None = optional("of satin: strength of a clear coat")
    grain: Axis | None = optional("of brushed metal: axis that scratches lie across: x, y, z or a vector")
    refraction: Annotated[float, Field(gt=1, le=4)] | None = optional(
        "of glass: its index of refraction, 1.5 for window glass and honey"
    )
    absorption: AbsorptionDocument | None = optional(
        "of glass: colour of light by the distance that it goes inside"
    )
    subsurface: SubsurfaceDocument | None = optional(
        "of clay, plastic and glass: light is scattered below the surface"
    )
    density: Annotated[float, Field(gt=0, le=1000)] | None = optional(
        "of smoke: how often light is scattered through half of the subject"
    )
    pigment: PigmentDocument | None = optional(
        "a pattern that replaces the colour and moves with the material"
    )
    measure: MeasureDocument | None = optional("a number that replaces the colour, shown by a colour map")
    relief: ReliefDocument | None = optional("a picture beside the shot file whose light parts stand out")
    projection: ProjectionDocument | None = optional("of pictures from files onto the subject at rest")
    wireframe: WireframeDocument | None = optional("the edges of the mesh, drawn over the look")

    _bsdf: Bsdf | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _is_complete(self, info: ValidationInfo) -> Self:
        if (self.material is None) == (self.bsdf is None):
            if self.bsdf is None:
                raise finding("look names no material. Add material: clay, or bsdf.")
            raise finding("look has both material and bsdf; it is made of one of them. Remove one.")
        if self.bsdf is None:
            return self._is_consistent()
        others = sorted(self.model_fields_set - {"bsdf", "projection", "wireframe"})
        if others:
            raise finding(f"look has {others[0]} beside bsdf, which sets it itself. Remove one of them.")
        context = ParseContext.of(info)
        if is_valid(self.bsdf, context.folder):  # else bsdf_problems reports where it stands
            self._bsdf = bsdf_of(self.bsdf, context)
        return self

    def _is_consistent(self) -> Self:
        assert self.material is not None
        look = LOOKS[self.material]
        pattern = next((name for name in ("pigment", "measure", "picture") if self._has(name)), None)
        if pattern and not isinstance(look, PatternedMaterial):
            reason = "light goes through" if look.is_clear else "scratches make the pattern of"
            looks = ", ".join(n for n, item in LOOKS.items() if isinstance(item, PatternedMaterial))
            raise finding(
                f"look has a {pattern}, and {reason} {self.material}, which has one colour. "
                f"Take one of {looks}, or write colour."
            )
        given = [name for name in ("colour", "pigment", "measure") if getattr(self, name)]
        if len(given) > 1:
            raise finding(
                f"look has both {given[0]} and {given[1]}; a {given[1]} has its own colours. Remove one of "
                "them."
            )
        for name, model_with in _MODEL_WITH.items():
            if getattr(self, name) is not None and look.model != model_with:
                fitting = listed((n for n, item in LOOKS.items() if item.model == model_with), "or")
                raise finding(
                    f"look has {name}, which {self.material} does not use. Remove it, or take {fitting}."
                )
        if self.projection and not (self.relief or self._has("picture") or self._has("rough")):
            raise finding(
                "look has a projection and no picture to project. Name a file as colour, roughness or "
                "relief, or remove it."
            )
        try:
            self.build()
        except RenderError as error:
            raise finding(f"{error}.") from None
        return self

    def _has(self, name: str) -> bool:
        """Tell whether a setting is given; "picture" is a file as colour, "rough" a file as roughness."""
        if name == "picture":
            return isinstance(self.colour, PictureDocument | Texture)
        return isinstance(self.roughness, Texture) if name == "rough" else getattr(self, name) is not None

    def build(self) -> Material:
        """Return the look. A colour replaces the look's own pattern and absorption."""
        if self.material is None:
            assert self._bsdf is not None, "an invalid one has been reported"
            base: Material = MitsubaMaterial.of(self._bsdf)
        else:
            base = LOOKS[self.material]
        named = {"material", "bsdf", "colour", "roughness", "grain", "wireframe", *_PARTS}
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude=named)
        if self.colour or self.pigment or self.measure:
            given |= {"pigment": None, "measure": None}
        if self.colour:
            given |= {"absorption": None, **self._colour_fields()}
        if self.roughness is not None:
            given["roughness_texture" if self._has("rough") else "roughness"] = self.roughness
        if self.grain:
            given["grain"] = axis(self.grain)
        for name in (*_PARTS, "wireframe"):
            if (part := getattr(self, name)) is not None:
                given[name] = part.build()
        return base.with_values(**given)

    def _colour_fields(self) -> dict[str, Any]:
        if isinstance(self.colour, list):
            return {"colour": vector(self.colour)}
        texture = self.colour.build() if isinstance(self.colour, PictureDocument) else self.colour
        return {"colour_texture": texture}


LookField = Annotated[
    Annotated[str, one_of(LOOKS, "look")] | LookDocument,
    MAPPING_IS_SECOND,
    no_bare_colour("look", "material: clay"),
]


def look_of(document: str | LookDocument) -> Material:
    """Return the look of the entry `look`."""
    return LOOKS[document] if isinstance(document, str) else document.build()
