"""The entry `bsdf` of a look: a material of Mitsuba, and the problems with it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.errors import shortened, suggestion
from pipeline.shot.documents.colours import HEX_PATTERN, is_hex, linear_of
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.lookup import is_there
from pipeline.shot.yaml.source import Problem, Where, YamlSource
from pipeline.shot.yaml.validation import ParseContext, missing_file
from render.base.errors import RenderError
from render.base.input_files import digest_of_file
from render.mitsuba.bsdf import refusal
from render.scene.materials.mitsuba_bsdf import BSDFS, PLUGINS, TEXTURES, Bsdf, MitsubaPlugin
from render.scene.textures import Texture, read_picture, reading_of

_KINDS = {
    "number": "a number",
    "bool": "true or false",
    "text": "a plain name",
    "index": "a number, or the name of a substance such as bk7",
    "file": "the name of a file",
    "texture": "a number, a colour such as [0.5, 0.4, 0.3], or a texture such as {type: bitmap, …}",
}


def bsdf_problems(source: YamlSource) -> Iterator[Problem]:
    """Yield the problems with a material; one without any is tried in Mitsuba."""
    bsdf, folder = source.get("look", "bsdf"), source.path.parent
    if bsdf is None:
        return
    where: Where = ("look", "bsdf")
    problems = list(_plugin(bsdf, where, folder))
    yield from problems
    if problems:
        return
    refused = refusal(bsdf_of(bsdf, ParseContext(folder)))
    if refused is not None:
        path, reason = refused
        yield (*where, *path), f"Mitsuba does not take this material: {reason}. Correct it."


def bsdf_of(bsdf: dict[str, Any], context: ParseContext) -> Bsdf:
    """Return the material, and note the digests of its files."""
    files: list[Texture] = []

    def with_textures(part: Any) -> Any:
        if not isinstance(part, dict):
            return linear_of(part) if is_hex(part) else part
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


def is_valid(bsdf: dict[str, Any], folder: Path) -> bool:
    """Tell whether a material has no problem that shows without Mitsuba."""
    return next(_plugin(bsdf, (), folder), None) is None


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
        yield (*where, "type"), f"{shortened(kind)} is no {role} of Mitsuba. {suggestion(kind, known)}"
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
            hint = suggestion(str(name), names) if names else "It takes none."
            yield place, f"{name} is no parameter of {kind}. {hint}"
    yield from _count(kind, form, inner, where)
    yield from _file(plugin, where, folder)


def _count(kind: str, form: MitsubaPlugin, inner: list[int], where: Where) -> Iterator[Problem]:
    least, most = form.materials
    if not least <= inner[0] <= most:
        wanted = str(least) if least == most else f"{least} or {most}"
        yield (
            where,
            f"{kind} contains {inner[0]} materials; it must contain {wanted}. Write them under any name.",
        )
    if inner[1] != form.textures:
        yield (
            where,
            f"{kind} contains {inner[1]} textures under other names; it must contain {form.textures}.",
        )


def _value(value: Any, kind: str, where: Where, folder: Path) -> Iterator[Problem]:
    if isinstance(value, dict) and kind == "texture":
        yield from _plugin(value, where, folder, "texture", tuple(TEXTURES))
        return
    is_colour = re.fullmatch(HEX_PATTERN, value) if isinstance(value, str) else _is_triple(value)
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


def _is_triple(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(is_number(part) for part in value)


def _file(plugin: dict[str, Any], where: Where, folder: Path) -> Iterator[Problem]:
    if "filename" not in PLUGINS[plugin["type"]].parameters:
        return
    name = plugin.get("filename")
    if name is None:
        yield where, f"{plugin['type']} names no file. Add `filename: …`."
    elif isinstance(name, str):
        path = folder / name
        if not is_there(path):
            yield (*where, "filename"), missing_file(name, path)
        elif plugin["type"] == "bitmap":
            space = plugin.get("space")
            try:
                read_picture(str(path), digest_of_file(path), space if isinstance(space, str) else None)
            except RenderError as error:
                yield (*where, "space" if "space" in str(error)[:6] else "filename"), f"{error}"
