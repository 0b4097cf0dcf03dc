"""The entry `look` of a shot file with its `bsdf`, and the look it becomes. Colours are linear Rec.709."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.errors import quote, suggest
from flowsculpt.pipeline.plugin import Plugin, plugins
from flowsculpt.pipeline.plugin_contracts import ContractError
from flowsculpt.pipeline.shot.documents.field_types import (
    HEX_PATTERN,
    MAPPING_IS_SECOND,
    Axis,
    Document,
    SchemaKeywords,
    ZeroToOne,
    axis,
    exactly_one,
    is_hex,
    is_number,
    is_triple,
    linear_of_hex,
    no_bare_colour,
    one_of,
    optional,
    vector,
)
from flowsculpt.pipeline.shot.documents.look_parts import (
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
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding, missing_file
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource, listed
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.render_errors import RenderError
from flowsculpt.render.mitsuba.bsdf_plugins import refusal
from flowsculpt.render.scene.materials import LOOKS, Material, MitsubaMaterial, PatternedMaterial
from flowsculpt.render.scene.materials.mitsuba_bsdf import BSDFS, PLUGINS, TEXTURES, Bsdf
from flowsculpt.render.scene.surface_detail import WEAR, worn
from flowsculpt.render.scene.textures import Texture, read_picture, reading_of


def _look_of_plugin(plugin: Plugin, name: str, look: Any) -> Material:
    """Return the look of a plug-in. Raises ContractError for what is none."""
    if not isinstance(look, Material):
        raise ContractError('it is not a Material; write such as LOOKS["clay"].with_values(roughness=0.2)')
    return look


ALL_LOOKS: Mapping[str, Material] = {**LOOKS, **plugins().parts("looks", _look_of_plugin)}
"""The looks that a shot can name, those of plug-ins last."""

_KINDS = {
    "number": "a number",
    "bool": "true or false",
    "text": "a plain name",
    "index": "a number, or the name of a substance such as bk7",
    "file": "the name of a file",
    "texture": "a number, a colour such as [0.5, 0.4, 0.3], or a texture such as {type: bitmap, …}",
}


def check_bsdf(source: YamlSource) -> Iterator[Problem]:
    """Yield the problems with a material; one without any is tried in Mitsuba."""
    bsdf, folder = source.get("look", "bsdf"), source.path.parent
    if bsdf is None:
        return
    where: Where = ("look", "bsdf")
    problems = list(_plugin(bsdf, where, folder))
    yield from problems
    if problems:
        return
    if refused := refusal(bsdf_of(bsdf, ParseContext(folder))):
        path, reason = refused
        yield (*where, *path), f"Mitsuba does not take this material: {reason}. Correct it."


def bsdf_of(bsdf: dict[str, Any], context: ParseContext) -> Bsdf:
    """Return the material, and note the digests of its files."""
    files: list[Texture] = []

    def with_textures(part: Any) -> Any:
        if not isinstance(part, dict):
            return linear_of_hex(part) if is_hex(part) else part
        plugin = {name: with_textures(value) for name, value in part.items()}
        if "filename" in plugin:
            path = context.file(plugin["filename"])
            space = "data" if plugin.get("raw") else plugin.pop("space", None)
            digest, is_picture = context.digests[path], plugin["type"] == "bitmap"
            reading = reading_of(str(path), digest, space) if is_picture else ""
            files.append(Texture(digest, space, str(path), reading=reading))
            plugin["filename"] = len(files) - 1
        return plugin

    text = json.dumps(with_textures(bsdf), sort_keys=True, separators=(",", ":"))
    return Bsdf(text, tuple(files))


def _plugin(
    plugin: Any, where: Where, folder: Path, role: str = "material", known: tuple[str, ...] = tuple(BSDFS)
) -> Iterator[Problem]:
    if not isinstance(plugin, dict) or not isinstance(plugin.get("type"), str):
        yield (
            where,
            f"a {role} of Mitsuba is a mapping with a type. Write {{type: {known[4 % len(known)]}}}.",
        )
        return
    kind = plugin["type"]
    if kind not in known:
        yield (*where, "type"), f"{quote(kind)} is not a {role} of Mitsuba. {suggest(kind, known)}"
        return
    form = PLUGINS[kind]
    inner = [0, 0]
    for name, value in plugin.items():
        if name == "type":
            continue
        place = (*where, name)
        if name in form.parameters:
            yield from _value(value, form.parameters[name], place, folder)
        elif isinstance(value, dict) and (form.materials[1] or form.textures):
            is_texture = value.get("type") in TEXTURES
            inner[is_texture] += 1
            yield from _plugin(value, place, folder, "texture" if is_texture else "material", tuple(PLUGINS))
        else:
            names = tuple(form.parameters)
            hint = suggest(str(name), names) if names else "It takes none."
            yield place, f"{name} is not a parameter of {kind}. {hint}"
    yield from ((where, fault) for fault in form.count_faults(kind, *inner))
    yield from _file(plugin, where, folder)


def _value(value: Any, kind: str, where: Where, folder: Path) -> Iterator[Problem]:
    if isinstance(value, dict) and kind == "texture":
        yield from _plugin(value, where, folder, "texture", tuple(TEXTURES))
        return
    is_colour = re.fullmatch(HEX_PATTERN, value) if isinstance(value, str) else is_triple(value)
    fits = {
        "number": is_number(value),
        "bool": isinstance(value, bool),
        "text": isinstance(value, str) and "/" not in value,  # Mitsuba makes a path of some
        "index": is_number(value) or isinstance(value, str),
        "file": isinstance(value, str),
        "texture": is_number(value) or bool(is_colour),
    }
    if not fits[kind]:
        yield where, f"{where[-1]} must be {_KINDS[kind]}."


def _file(plugin: dict[str, Any], where: Where, folder: Path) -> Iterator[Problem]:
    if "filename" not in PLUGINS[plugin["type"]].parameters:
        return
    name = plugin.get("filename")
    if name is None:
        yield where, f"{plugin['type']} names no file. Add `filename: …`."
    elif isinstance(name, str):
        path = folder / name
        if not InputFile(path).is_there():
            yield (*where, "filename"), missing_file(name, path)
        elif plugin["type"] == "bitmap":
            space = plugin.get("space")
            try:
                read_picture(str(path), InputFile(path).digest(), space if isinstance(space, str) else None)
            except RenderError as error:
                yield (*where, "space" if "space" in str(error)[:6] else "filename"), f"{error}"


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

    material: Annotated[str, one_of(ALL_LOOKS, "look")] | None = optional("the look to start from")
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
    wear: dict[Annotated[str, one_of(WEAR, "kind of wear")], ZeroToOne] | None = optional(
        f"amounts from 0 to 1, of what use leaves on the surface: {', '.join(WEAR)}"
    )
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
        if not any(_plugin(self.bsdf, (), context.folder)):  # else check_bsdf reports where
            self._bsdf = bsdf_of(self.bsdf, context)
        return self

    def _is_consistent(self) -> Self:
        assert self.material is not None
        look = ALL_LOOKS[self.material]
        pattern = next((name for name in ("pigment", "measure", "picture") if self._has(name)), None)
        if pattern and not isinstance(look, PatternedMaterial):
            reason = "light goes through" if look.is_clear else "scratches make the pattern of"
            looks = ", ".join(n for n, item in ALL_LOOKS.items() if isinstance(item, PatternedMaterial))
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
                fitting = listed((n for n, item in ALL_LOOKS.items() if item.model == model_with), "or")
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
            base = ALL_LOOKS[self.material]
        named = {"material", "bsdf", "colour", "roughness", "grain", "wireframe", "wear", *_PARTS}
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude=named)
        if self.colour or self.pigment or self.measure:
            given |= {"pigment": None, "measure": None}
        if self.colour:
            given |= {"absorption": None, **self._colour_fields()}
        if self.roughness is not None:
            given["roughness_texture" if self._has("rough") else "roughness"] = self.roughness
        if self.wear is not None:
            given["wear"] = worn(self.wear)
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
    Annotated[str, one_of(ALL_LOOKS, "look")] | LookDocument,
    MAPPING_IS_SECOND,
    no_bare_colour("look", "material: clay"),
]


def look_of(document: str | LookDocument) -> Material:
    """Return the look of the entry `look`."""
    return ALL_LOOKS[document] if isinstance(document, str) else document.build()
