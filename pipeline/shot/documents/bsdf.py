"""What a shot file says under `look: {bsdf: …}`: a material of Mitsuba, and what is wrong with it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.errors import suggestion
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.lookup import digest_of_file, is_there, shown
from pipeline.shot.yaml.parse_context import Surroundings
from pipeline.shot.yaml.source import Source, Where
from render.base.errors import RenderError
from render.mitsuba.bsdf_check import refusal
from render.scene.bsdf import BSDFS, FORMS, TEXTURES, Bsdf, Form
from render.scene.textures import Texture, read_picture

_WHAT = {
    "number": "a number",
    "bool": "true or false",
    "text": "text",
    "index": "a number, or the name of a substance such as bk7",
    "file": "the name of a file",
    "texture": "a number, a colour such as [0.5, 0.4, 0.3], or a texture such as {type: bitmap, …}",
}


def written_out(source: Source) -> Iterator[Problem]:
    """All that is wrong with the material, and if nothing is, what Mitsuba has against it."""
    said, folder = source.get("look", "bsdf"), source.path.parent
    if said is None:
        return
    where: Where = ("look", "bsdf")
    found = list(_material(said, where, folder))
    yield from found
    if found:
        return
    refused = refusal(bsdf_of(said, Surroundings(folder)))
    if refused is not None:
        way, why = refused
        yield (*where, *way), f"Mitsuba does not take this material: {why}. Correct it."


def bsdf_of(said: dict[str, Any], around: Surroundings) -> Bsdf:
    """The material; the digests of its files are noted."""
    files: list[Texture] = []

    def settled(part: Any) -> Any:
        if not isinstance(part, dict):
            return part
        made = {name: settled(value) for name, value in part.items()}
        if "filename" in made:
            path = around.file(made["filename"])
            space = "data" if made.get("raw") else made.pop("space", None)
            files.append(Texture(around.digests[path], space, str(path)))
            made["filename"] = len(files) - 1
        return made

    text = json.dumps(settled(said), sort_keys=True, separators=(",", ":"))
    return Bsdf(text, tuple(files))


def is_sound(said: dict[str, Any], folder: Path) -> bool:
    """Whether nothing is wrong that can be told without Mitsuba."""
    return next(_material(said, (), folder), None) is None


def _material(said: Any, where: Where, folder: Path) -> Iterator[Problem]:
    yield from _plugin(said, where, folder, "material", tuple(BSDFS))


def _plugin(said: Any, where: Where, folder: Path, what: str, known: tuple[str, ...]) -> Iterator[Problem]:
    if not isinstance(said, dict) or not isinstance(said.get("type"), str):
        yield (
            where,
            f"a {what} of Mitsuba is a mapping that says its type. Write {{type: {known[4 % len(known)]}}}.",
        )
        return
    kind = said["type"]
    if kind not in known:
        yield (*where, "type"), f"{shown(kind)!r} is no {what} of Mitsuba. {suggestion(kind, known)}"
        return
    form = FORMS[kind]
    inner = [0, 0]
    for name, value in said.items():
        if name == "type":
            continue
        place = (*where, name)
        if name in form.parameters:
            yield from _value(value, form.parameters[name], place, folder)
        elif _nests(form, value):
            is_texture = value.get("type") in TEXTURES
            inner[is_texture] += 1
            yield from _plugin(value, place, folder, "texture" if is_texture else "material", tuple(FORMS))
        else:
            names = tuple(form.parameters)
            hint = suggestion(str(name), names) if names else "It takes none."
            yield place, f"{name} is no parameter of {kind}. {hint}"
    yield from _count(kind, form, inner, where)
    yield from _file(said, where, folder)


def _nests(form: Form, value: Any) -> bool:
    return isinstance(value, dict) and bool(form.materials[1] or form.textures)


def _count(kind: str, form: Form, inner: list[int], where: Where) -> Iterator[Problem]:
    least, most = form.materials
    if not least <= inner[0] <= most:
        wanted = str(least) if least == most else f"{least} or {most}"
        yield (
            where,
            f"{kind} has {inner[0]} materials within it; it must have {wanted}. Write them by any name.",
        )
    if inner[1] != form.textures:
        yield where, f"{kind} has {inner[1]} textures within it by other names; it must have {form.textures}."


def _value(value: Any, kind: str, where: Where, folder: Path) -> Iterator[Problem]:
    if isinstance(value, dict) and kind == "texture":
        yield from _plugin(value, where, folder, "texture", tuple(TEXTURES))
        return
    is_colour = isinstance(value, list) and len(value) == 3 and all(is_number(part) for part in value)
    fits = {
        "number": is_number(value),
        "bool": isinstance(value, bool),
        "text": isinstance(value, str),
        "index": is_number(value) or isinstance(value, str),
        "file": isinstance(value, str),
        "texture": is_number(value) or is_colour,
    }
    if not fits[kind]:
        yield where, f"{where[-1]} must be {_WHAT[kind]}."


def _file(said: dict[str, Any], where: Where, folder: Path) -> Iterator[Problem]:
    if "filename" not in FORMS[said["type"]].parameters:
        return
    name = said.get("filename")
    if name is None:
        yield where, f"{said['type']} names no file. Add `filename: …`."
    elif isinstance(name, str):
        path = folder / name
        if not is_there(path):
            yield (
                (*where, "filename"),
                f"file {shown(name)} is not there; it is looked for beside the shot file, as {shown(path)}. "
                "Put it there or correct the name.",
            )
        elif said["type"] == "bitmap":
            space = said.get("space")
            try:
                read_picture(str(path), digest_of_file(path), space if isinstance(space, str) else None)
            except RenderError as error:
                yield (*where, "space" if "space" in str(error)[:6] else "filename"), f"{error}"
