"""Surfaces in glTF files, .gltf and .glb (Khronos, glTF 2.0), read in a process of its own.

A scene may hold counts that no file can hold, and data that a library decompresses.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.errors import MachineError, MissingInputError
from pipeline.mesh.mesh_formats import FileSurface, file_surface
from pipeline.plugins.interchange.gltf_arrays import SceneArrays
from pipeline.plugins.interchange.gltf_document import MOST_BYTES, GltfDocument
from pipeline.plugins.interchange.gltf_scene import DefaultScene
from render.base.input_files import require_input
from render.base.limited_process import MEMORY, allow_memory, answer_of, serve
from render.base.plural import plural
from render.base.python_process import command_line

GLTF_FORMATS = ("glb", "gltf")


def require_draco() -> None:
    """Raise MachineError where the package that decodes Draco data is not installed."""
    if find_spec("DracoPy") is None:
        raise MachineError(
            "glTF files with Draco data need the package DracoPy, which is not installed; install the extra "
            "[models], "
            f"or only the package, for the Python of flowsculpt: {command_line('pip', 'install', 'DracoPy')}"
        )


class SceneFiles(NamedTuple):
    """The inputs of a glTF file's surface besides the file itself.

    buffers  files that it is read from
    reader   version of the reader, where an earlier one read this file otherwise; else empty
    """

    buffers: tuple[Path, ...]
    reader: tuple[str, ...]


def scene_files(path: Path) -> SceneFiles:
    """Return the files besides a glTF file that its surface is read from. Raises as `read_gltf`."""
    scene = DefaultScene.of(GltfDocument.read(path))
    return SceneFiles(_buffer_files(scene), ("glTF reader 2",) if scene.was_misread else ())


def _buffer_files(scene: DefaultScene) -> tuple[Path, ...]:
    """Return the files of a scene's buffers. Raises MissingInputError where one is not there."""
    files: dict[Path, None] = {}
    for index in sorted(scene.buffers):
        file = scene.document.buffer_file(index)
        if file is None:
            continue
        try:
            require_input(file, MOST_BYTES)
        except MissingInputError as error:
            raise MissingInputError(f"{scene.document.path}: its buffer {index} refers to {error}") from None
        files[file] = None
    return tuple(files)


def read_gltf(path: Path) -> FileSurface:
    """Read the default scene of a file as one surface.

    Raises ValueError or ParserError where it cannot be read, MissingInputError for a missing buffer.
    """
    scene = DefaultScene.of(GltfDocument.read(path))
    if scene.needs_draco:
        require_draco()
    _buffer_files(scene)
    answer = answer_of("pipeline.plugins.interchange.gltf_files", path)
    arrays = io.BytesIO(answer)
    points, faces = np.load(arrays, allow_pickle=False), np.load(arrays, allow_pickle=False)
    surface = file_surface(points, faces, base=None)
    return surface._replace(notes=tuple(_notes(scene)))


def _notes(scene: DefaultScene) -> Iterator[str]:
    """Yield lines to tell the user about what is not read as other programs show it."""
    if not (scene.parts or scene.skipped) and scene.document.root.items("meshes"):
        yield "no node of its default scene has a mesh with triangles"
    if scene.skipped:
        there = "is" if scene.skipped == 1 else "are"
        yield f"{plural(scene.skipped, 'primitive')} of points or lines {there} left out"
    if scene.morphed:
        yield (
            f"the morph targets of {plural(scene.morphed, 'primitive')} are not applied, though their weights"
            " are not 0; if they should show, apply them in the program that made the file"
        )


def _arrays(path: str) -> bytes:
    """Return vertices (V, 3) and faces (F, 3) as two npy files, one after the other."""
    scene = DefaultScene.of(GltfDocument.read(Path(path)))
    files = (Path(path), *_buffer_files(scene))
    allow_memory(MEMORY + 40 * sum(require_input(file, MOST_BYTES) for file in files))
    surface = SceneArrays(scene).surface()
    file = io.BytesIO()
    np.save(file, surface.points, allow_pickle=False)
    np.save(file, surface.faces, allow_pickle=False)
    return file.getvalue()


if __name__ == "__main__":
    serve(_arrays)
