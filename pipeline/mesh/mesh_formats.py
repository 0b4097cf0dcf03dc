"""Formats of mesh files: those of the core, and those that plug-ins add."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

from pipeline.mesh.file_surface import FileSurface
from pipeline.mesh.obj_files import read_wavefront
from pipeline.mesh.off_files import read_object_file
from pipeline.mesh.ply_files import read_polygon_file
from pipeline.mesh.stl_files import read_stl
from pipeline.plugin import named, plugins
from render.base.input_files import digest_of_file, joint_digest, opened_input, read_input

T = TypeVar("T")

MOST_BYTES = 1 << 30
"""Bytes of a mesh file at most."""


@dataclass(frozen=True)
class ScenePart:
    """The part of a scene that is a model, and when.

    prim       path of the prim whose meshes are read; None for the scene's default prim, or all of it
    time_code  time of the scene; None for its first
    """

    prim: str | None = None
    time_code: float | None = None


class ModelFiles(NamedTuple):
    """The files that a model is read from.

    digest  SHA-256 of their contents
    files   SHA-256 of each, by its path: the model's own file first, then the others that its reader opens,
            which are layers of a USD stage and buffers of a glTF scene
    up      axis that points up, y or z; None in formats that do not say it
    """

    digest: str
    files: tuple[tuple[Path, str], ...]
    up: str | None = None


@dataclass(frozen=True)
class MeshFormat:
    """A format of mesh files.

    read       reads a surface. Raises MeshError, or any error, where it cannot
    files      returns the files that a surface is read from; None where it is the one file
    states_up  whether files say which axis points up; `files` then returns it
    usual_up   axis, y or z, that points up in most files of a format that does not say it
    read_part  reads a part of a scene; None where parts have no names
    """

    read: Callable[[Path], FileSurface]
    files: Callable[[Path], ModelFiles] | None = None
    states_up: bool = False
    usual_up: str = "y"
    read_part: Callable[[Path, ScenePart], FileSurface] | None = None


def reader_of(parse: Callable[[bytes], T]) -> Callable[[Path], T]:
    """Return the reader of files whose content `parse` reads."""
    return lambda path: parse(read_input(path, MOST_BYTES))


def suffix_of(path: str | Path) -> str:
    """Return the suffix of a path in small letters, without its dot."""
    return Path(path).suffix.lower().lstrip(".")


_CORE = {
    "obj": MeshFormat(reader_of(read_wavefront)),
    "ply": MeshFormat(reader_of(read_polygon_file)),
    "stl": MeshFormat(reader_of(read_stl), usual_up="z"),  # most come from printing and construction
    "off": MeshFormat(reader_of(read_object_file)),
}


def mesh_suffixes() -> tuple[str, ...]:
    """Return the suffixes of readable mesh files."""
    return (*_CORE, *plugins().mesh_formats)


def format_of(path: str | Path) -> MeshFormat | None:
    """Return the format of a file by its suffix; None where nothing reads it."""
    suffix = suffix_of(path)
    place = plugins().mesh_formats.get(suffix)
    found: MeshFormat | None = _CORE.get(suffix) or (named(place) if place else None)
    return found


def names_parts(path: str | Path) -> bool:
    """Tell whether parts of scenes in a file's format have names, as prims of USD have."""
    form = format_of(path)
    return form is not None and form.read_part is not None


def own_file(path: Path) -> ModelFiles:
    """Return the files of a model that is read from one."""
    digest = digest_of_file(path)
    reader = ["text reader 2"] if _was_misread(path) else []
    return ModelFiles(joint_digest([*reader, digest]), ((path, digest),))


_MISREAD = {
    "obj": re.compile(
        rb"\A\xef\xbb\xbf|^[ \t]*(?:o|g|usemtl|mtllib)[ \t][^\r\n]*\\[ \t]*[\r\n]", re.MULTILINE
    ),
    "off": re.compile(rb"^[ \t]*(?:ST|C|N)*4n?OFF", re.MULTILINE),
    "ply": re.compile(rb"[\r\n]element[ \t]+tristrips[ \t]"),
}
"""What files begin with that an earlier reader read otherwise: they are other models now.

It lost the first vertex behind a byte order mark, and statements behind names that end in a backslash; it
divided by no w, and left out strips of triangles.
"""


def _was_misread(path: Path) -> bool:
    pattern = _MISREAD.get(suffix_of(path))
    if pattern is None:
        return False
    with opened_input(path) as (file, size):
        return pattern.search(file.read(min(size, 1 << 14))) is not None
