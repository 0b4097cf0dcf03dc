"""Materials written out for Mitsuba, and the table of what they take.

`PLUGINS` lists the parameters of materials and textures by their names in Mitsuba's manual. Shot files are
checked by it without starting Mitsuba.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flowsculpt.render.base.serialise import NOT_PLAIN, Triple
from flowsculpt.render.scene.rgb_spaces import REC709, WORKING_SPACES, WorkingSpace
from flowsculpt.render.scene.textures import Texture


class MitsubaPlugin(NamedTuple):
    """Parameters of a plugin by name and kind, and how many materials and textures it nests.

    Kinds are "texture" (a number, a colour or a texture), "number", "bool", "text", "index" (a number, or the
    name of a substance) and "file".
    """

    parameters: Mapping[str, str]
    materials: tuple[int, int] = (0, 0)
    textures: int = 0

    def count_faults(self, kind: str, materials: int, textures: int) -> Iterator[str]:
        """Yield what is wrong with so many nested materials and textures. kind: its name"""
        least, most = self.materials
        if not least <= materials <= most:
            wanted = str(least) if least == most else f"{least} or {most}"
            yield (
                f"{kind} contains {materials} materials; it must contain {wanted}. Write them under any name."
            )
        if textures != self.textures:
            yield f"{kind} contains {textures} textures under other names; it must contain {self.textures}."


def _plugin(materials: tuple[int, int] = (0, 0), textures: int = 0, **kinds: str) -> MitsubaPlugin:
    return MitsubaPlugin(
        {name: kind for kind, names in kinds.items() for name in names.split()}, materials, textures
    )


_FACES = "specular_reflectance specular_transmittance"
_COATED = "diffuse_reflectance specular_reflectance"
_METAL = "eta k specular_reflectance"
_DISNEY = "base_color roughness anisotropic spec_trans sheen sheen_tint flatness spec_tint"

BSDFS = {
    "blendbsdf": _plugin((2, 2), texture="weight"),
    "bumpmap": _plugin((1, 1), 1, number="scale"),
    "conductor": _plugin(text="material", texture=_METAL),
    "dielectric": _plugin(index="int_ior ext_ior", texture=_FACES),
    "diffuse": _plugin(texture="reflectance"),
    "mask": _plugin((1, 1), texture="opacity"),
    "measured": _plugin(file="filename"),
    "normalmap": _plugin((1, 1), texture="normalmap"),
    "null": _plugin(),
    "plastic": _plugin(index="int_ior ext_ior", texture=_COATED, bool="nonlinear"),
    "principled": _plugin(texture=f"{_DISNEY} metallic clearcoat clearcoat_gloss", number="eta specular"),
    "principledthin": _plugin(texture=f"{_DISNEY} diff_trans", number="eta"),
    "roughconductor": _plugin(
        text="material distribution", texture=f"{_METAL} alpha alpha_u alpha_v", bool="sample_visible"
    ),
    "roughdielectric": _plugin(
        index="int_ior ext_ior",
        texture=f"{_FACES} alpha alpha_u alpha_v",
        text="distribution",
        bool="sample_visible",
    ),
    "roughplastic": _plugin(
        index="int_ior ext_ior",
        texture=_COATED,
        number="alpha",
        text="distribution",
        bool="nonlinear sample_visible",
    ),
    "thindielectric": _plugin(index="int_ior ext_ior", texture=_FACES),
    "twosided": _plugin((1, 2)),
}
TEXTURES = {
    "bitmap": _plugin(file="filename", text="filter_type wrap_mode space", bool="raw"),
    "checkerboard": _plugin(texture="color0 color1"),
    "rgb": _plugin(texture="value"),
}
PLUGINS = {**BSDFS, **TEXTURES}

_CLEAR = ("dielectric", "roughdielectric", "thindielectric", "principledthin", "mask", "null")
"""Materials that light passes through."""

_METALS = ("conductor", "roughconductor")

_COLOURS = ("base_color", "reflectance", "diffuse_reflectance", "specular_reflectance")

_INDICES = ("eta", "k")
"""Complex indices of refraction: not colours, although they differ between red, green and blue."""

Plain = dict[str, Any]


@dataclass(frozen=True)
class Bsdf:
    """The description of a Mitsuba material.

    text   JSON, in which a file is named by its index in `files`
    files  textures, and tables of measured materials

    working_space  the space that its colours are converted to; `eta` and `k` stay as written
    """

    text: str
    files: tuple[Texture, ...] = ()
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)

    @property
    def description(self) -> Plain:
        """The parsed `text`, with its colours in the working space."""
        parsed, space = json.loads(self.text), WORKING_SPACES[self.working_space]
        return parsed if space.is_rec709 else _convert(parsed, space)

    @property
    def is_clear(self) -> bool:
        """True if light passes through some of it."""
        return any(
            part["type"] in _CLEAR or "spec_trans" in part
            for part in _parts(self.description)
            if "type" in part
        )

    @property
    def is_metal(self) -> bool:
        """True if some of it is a metal."""
        return any(part.get("type") in _METALS for part in _parts(self.description))

    @property
    def colour(self) -> Triple:
        """An approximate reflectance, for pictures without a path tracer."""
        for part in _parts(self.description):
            for name in _COLOURS:
                if isinstance(part.get(name), list):
                    red, green, blue = (min(max(float(x), 0.0), 1.0) for x in part[name])
                    return red, green, blue
        return 0.6, 0.6, 0.6


def _convert(part: Any, space: WorkingSpace) -> Any:
    """Return a part of a description with its lists of three numbers, which are colours, in a space."""
    if isinstance(part, dict):
        return {name: value if name in _INDICES else _convert(value, space) for name, value in part.items()}
    if isinstance(part, list) and len(part) == 3 and all(isinstance(item, int | float) for item in part):
        return space.from_rec709(np.array(part)).tolist()
    return [_convert(item, space) for item in part] if isinstance(part, list) else part


def _parts(part: Any) -> Iterator[Plain]:
    """Yield every mapping of a description."""
    if isinstance(part, dict):
        yield part
        for inner in part.values():
            yield from _parts(inner)
