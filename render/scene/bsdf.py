"""Materials of Mitsuba as a look has them, and what they may say.

`FORMS` is what materials and textures take, by their names in Mitsuba's manual: it finds mistakes where they
stand without starting Mitsuba.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from render.base.serialise import Triple
from render.scene.textures import Texture


class Form(NamedTuple):
    """What a plugin takes: parameters by name and kind, and how many materials and textures within it.

    Kinds are "texture" (a number, a colour or a texture), "number", "bool", "text", "index" (a number, or the
    name of a substance) and "file".
    """

    parameters: Mapping[str, str]
    materials: tuple[int, int] = (0, 0)
    textures: int = 0


def _form(materials: tuple[int, int] = (0, 0), textures: int = 0, **kinds: str) -> Form:
    return Form({name: kind for kind, names in kinds.items() for name in names.split()}, materials, textures)


_FACES = "specular_reflectance specular_transmittance"
_COATED = "diffuse_reflectance specular_reflectance"
_METAL = "eta k specular_reflectance"
_DISNEY = "base_color roughness anisotropic spec_trans sheen sheen_tint flatness spec_tint"

BSDFS = {
    "blendbsdf": _form((2, 2), texture="weight"),
    "bumpmap": _form((1, 1), 1, number="scale"),
    "conductor": _form(text="material", texture=_METAL),
    "dielectric": _form(index="int_ior ext_ior", texture=_FACES),
    "diffuse": _form(texture="reflectance"),
    "mask": _form((1, 1), texture="opacity"),
    "measured": _form(file="filename"),
    "normalmap": _form((1, 1), texture="normalmap"),
    "null": _form(),
    "plastic": _form(index="int_ior ext_ior", texture=_COATED, bool="nonlinear"),
    "principled": _form(texture=f"{_DISNEY} metallic clearcoat clearcoat_gloss", number="eta specular"),
    "principledthin": _form(texture=f"{_DISNEY} diff_trans", number="eta"),
    "roughconductor": _form(
        text="material distribution", texture=f"{_METAL} alpha alpha_u alpha_v", bool="sample_visible"
    ),
    "roughdielectric": _form(
        index="int_ior ext_ior",
        texture=f"{_FACES} alpha alpha_u alpha_v",
        text="distribution",
        bool="sample_visible",
    ),
    "roughplastic": _form(
        index="int_ior ext_ior",
        texture=_COATED,
        number="alpha",
        text="distribution",
        bool="nonlinear sample_visible",
    ),
    "thindielectric": _form(index="int_ior ext_ior", texture=_FACES),
    "twosided": _form((1, 2)),
}
TEXTURES = {
    "bitmap": _form(file="filename", text="filter_type wrap_mode space", bool="raw"),
    "checkerboard": _form(texture="color0 color1"),
    "rgb": _form(texture="value"),
}
FORMS = {**BSDFS, **TEXTURES}

_CLEAR = ("dielectric", "roughdielectric", "thindielectric", "principledthin", "mask", "null")
"""Materials that light goes through."""

_COLOURS = ("base_color", "reflectance", "diffuse_reflectance", "specular_reflectance")

Plain = dict[str, Any]


@dataclass(frozen=True)
class Bsdf:
    """A material of Mitsuba.

    text   its description as JSON, in which files are named by their place among `files`
    files  pictures, and tables of measured materials
    """

    text: str
    files: tuple[Texture, ...] = ()

    @property
    def description(self) -> Plain:
        found: Plain = json.loads(self.text)
        return found

    @property
    def is_clear(self) -> bool:
        """Whether light goes through some of it."""
        return any(
            part["type"] in _CLEAR or "spec_trans" in part
            for part in _within(self.description)
            if "type" in part
        )

    @property
    def colour(self) -> Triple:
        """About what it reflects, for pictures without a path tracer."""
        for part in _within(self.description):
            for name in _COLOURS:
                if isinstance(part.get(name), list):
                    red, green, blue = (min(max(float(x), 0.0), 1.0) for x in part[name])
                    return red, green, blue
        return 0.6, 0.6, 0.6


def _within(part: Any) -> Iterator[Plain]:
    if isinstance(part, dict):
        yield part
        for inner in part.values():
            yield from _within(inner)
