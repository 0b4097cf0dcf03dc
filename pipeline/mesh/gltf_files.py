"""Surfaces in glTF files, .gltf and .glb (Khronos, glTF 2.0), read by trimesh in a process of its own.

A scene may hold pictures in any format, cycles of nodes, and counts that no file can hold.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from pipeline.mesh.file_surface import FileSurface, early_end, file_surface
from render.base.input_files import read_input, require_input
from render.base.limited_process import MEMORY, allow_memory, answer_of, serve

MOST_BYTES = 1 << 30
"""Size of the largest file."""


def read_gltf(path: Path) -> FileSurface:
    """Read all meshes of a scene as one surface.

    Raises ValueError for a file that ends early, ParserError where trimesh cannot read it.
    """
    if path.suffix.lower() == ".glb":
        _require_whole(read_input(path, MOST_BYTES))
    arrays = io.BytesIO(answer_of("pipeline.mesh.gltf_files", path))
    vertices, faces = np.load(arrays, allow_pickle=False), np.load(arrays, allow_pickle=False)
    return file_surface(vertices, faces, base=None)


def _require_whole(content: bytes) -> None:
    if content[:4] != b"glTF":
        raise ValueError("it has no GLB header")
    promised = int.from_bytes(content[8:12], "little")
    if len(content) < max(promised, 12):
        raise early_end(max(promised, 12), "byte", len(content))


def _arrays(path: str) -> bytes:
    """Return vertices (V, 3) and faces (F, 3) as two npy files, one after the other."""
    import trimesh

    allow_memory(MEMORY + 40 * require_input(Path(path), MOST_BYTES))
    scene = trimesh.load(path, force="mesh", process=False, maintain_order=True)
    file = io.BytesIO()
    np.save(file, np.asarray(scene.vertices, np.float64), allow_pickle=False)
    np.save(file, np.asarray(scene.faces, np.int64).reshape(-1, 3), allow_pickle=False)
    return file.getvalue()


if __name__ == "__main__":
    serve(_arrays)
