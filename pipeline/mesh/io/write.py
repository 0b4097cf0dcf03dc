"""Writing meshes: each format as exactly as it can hold the numbers, and never half a file."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.errors import MeshError
from pipeline.mesh.normals import NORMAL, face_normals, vertex_normals
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import TriangleMesh
from render.base.atomic_write import atomic_write

_PLY_TYPES = {"f8": "double", "f4": "float", "i4": "int", "i2": "short", "i1": "char", "u1": "uchar"}
_COMPONENTS = {NORMAL: ("nx", "ny", "nz")}
_FLOAT, _UNSIGNED, _VERTICES, _INDICES = 5126, 5125, 34962, 34963  # glTF's names for types and uses


Mesh = TriangleMesh | PolygonMesh


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a surface in the format of the suffix, under a temporary name first.

    Polygons stay polygons in PLY, OBJ and OFF; the other formats get triangles.

    ply   binary, float64, with the vertex attributes, one number a property: name_x, name_y, …; nx, ny, nz
    obj   text that reads back as the same float64; with the attribute `normal`, where there is one
    off   text that reads back as the same float64
    stl   binary, float32, loose triangles
    glb   float32, with vertex normals
    npz   float64: vertices, faces, creases and each attribute as `attribute:<name>`

    Raises MeshError for another suffix and MachineError where the file cannot be written.
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lstrip(".").lower())
    if writer is None:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not a mesh format that can be written; "
            f"use one of {', '.join(WRITERS)}"
        )
    with atomic_write(path, flush=False) as draft:
        draft.write_bytes(writer(mesh))


def _ply(mesh: Mesh) -> bytes:
    columns = {"x": mesh.vertices[:, 0], "y": mesh.vertices[:, 1], "z": mesh.vertices[:, 2]}
    columns |= {name: values for name, values in _scalars(mesh.attributes) if name not in columns}
    rows = np.empty(len(mesh.vertices), [(name, _ply_type(values)) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    offsets, corners = _faces(mesh)
    count_type, faces = _counted(offsets, corners)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {_PLY_TYPES[rows.dtype[name].str[1:]]} {name}" for name in columns]
    header += [
        f"element face {len(offsets) - 1}",
        f"property list {count_type} int vertex_indices",
        "end_header",
        "",
    ]
    return "\n".join(header).encode("ascii", "replace") + rows.tobytes() + faces


def _faces(mesh: Mesh) -> tuple[Indices, Indices]:
    """Where each face's corners begin, and all corners."""
    if isinstance(mesh, PolygonMesh):
        return mesh.offsets, mesh.corners
    return np.arange(0, mesh.faces.size + 1, 3, dtype=np.int32), mesh.faces.reshape(-1)


def _counted(offsets: Indices, corners: Indices) -> tuple[str, bytes]:
    """Each face's number of corners and they, as PLY lists; and the type of the numbers."""
    sides = np.diff(offsets)
    kind, word = ("<u1", "uchar") if sides.max(initial=0) < 256 else ("<i4", "int")
    counts = sides.astype(kind)
    raw = np.zeros(counts.nbytes + 4 * len(corners), np.uint8)
    starts = 4 * offsets[:-1] + counts.itemsize * np.arange(len(sides))
    of_counts = (starts[:, None] + np.arange(counts.itemsize)).reshape(-1)
    of_corners = np.ones(len(raw), bool)
    of_corners[of_counts] = False
    raw[of_counts], raw[of_corners] = counts.view(np.uint8), corners.astype("<i4").view(np.uint8)
    return word, raw.tobytes()


def _listed(mesh: Mesh) -> Iterator[list[int]]:
    """The corners of each face."""
    offsets, corners = _faces(mesh)
    for start, end in pairwise(offsets.tolist()):
        yield corners[start:end].tolist()


def _ply_type(values: AnyArray) -> str:
    """The type of a property: its own where the format has it, otherwise the next that holds it."""
    own = values.dtype.str[1:]
    kept = own if own in _PLY_TYPES else "u1" if values.dtype.kind == "b" else "f8"
    return f"<{kept}" if kept[1] != "1" else kept


def _scalars(attributes: Mapping[str, AnyArray]) -> Iterator[tuple[str, AnyArray]]:
    """Attributes one number a vertex at a time, for readers do not know what to make of lists."""
    for name, values in attributes.items():
        word = "_".join(name.split()) or "attribute"
        if values.ndim == 1:
            yield word, values
            continue
        flat = values.reshape(len(values), -1)
        letters = tuple(f"{word}_{c}" for c in ("xyz" if flat.shape[1] == 3 else range(flat.shape[1])))
        yield from zip(_COMPONENTS.get(name, letters), flat.T, strict=False)


def _obj(mesh: Mesh) -> bytes:
    out = io.StringIO()
    out.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    normals = mesh.attributes.get(NORMAL)
    if normals is not None:
        out.writelines(f"vn {x!r} {y!r} {z!r}\n" for x, y, z in normals.tolist())
    for face in _listed(mesh):
        corners = (f"{v + 1}" if normals is None else f"{v + 1}//{v + 1}" for v in face)
        out.write(f"f {' '.join(corners)}\n")
    out.writelines(f"t crease 2/1/0 {a} {b} 10\n" for a, b in mesh.creases.tolist())
    return out.getvalue().encode()


def _off(mesh: Mesh) -> bytes:
    out = io.StringIO()
    out.write(f"OFF\n{len(mesh.vertices)} {len(_faces(mesh)[0]) - 1} 0\n")
    out.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    out.writelines(f"{len(face)} {' '.join(map(str, face))}\n" for face in _listed(mesh))
    return out.getvalue().encode()


def _stl(mesh: Mesh) -> bytes:
    mesh = _triangles(mesh)
    rows = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["normal"], rows["corners"] = face_normals(mesh), mesh.vertices[mesh.faces]
    return b"flowsculpt".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def _glb(mesh: Mesh) -> bytes:
    """glTF 2.0, binary: a JSON chunk that describes the chunk of numbers behind it."""
    mesh = _triangles(mesh)
    points, normals = mesh.vertices.astype("<f4"), _shading(mesh).astype("<f4")
    parts = [points.tobytes(), normals.tobytes(), mesh.faces.astype("<u4").tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(part), "target": use}
        for start, part, use in zip(starts, parts, (_VERTICES, _VERTICES, _INDICES), strict=False)
    ]
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    accessors = [
        {"bufferView": 0, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds},
        {"bufferView": 1, "componentType": _FLOAT, "count": len(points), "type": "VEC3"},
        {"bufferView": 2, "componentType": _UNSIGNED, "count": mesh.faces.size, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}
    scene = {
        "asset": {"version": "2.0", "generator": "flowsculpt"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": starts[-1]}],
    }
    words = json.dumps(scene, separators=(",", ":")).encode()
    words += b" " * (-len(words) % 4)
    chunks = _chunk(b"JSON", words) + _chunk(b"BIN\0", b"".join(parts))
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def _triangles(mesh: Mesh) -> TriangleMesh:
    return mesh if isinstance(mesh, TriangleMesh) else mesh.triangulated()


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + kind + content


def _shading(mesh: TriangleMesh) -> Floats:
    """A unit normal for every vertex: its own, or where it has none that of the faces around."""
    smooth = vertex_normals(mesh)
    own = mesh.attributes.get(NORMAL)
    if own is not None:
        known = np.linalg.norm(own, axis=1) > 0.5
        smooth[known] = own[known] / np.linalg.norm(own[known], axis=1, keepdims=True)
    return smooth


def _npz(mesh: Mesh) -> bytes:
    mesh = _triangles(mesh)
    out = io.BytesIO()
    named = {f"attribute:{name}": values for name, values in mesh.attributes.items()}
    arrays: dict[str, AnyArray] = {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases}
    np.savez(out, **{**arrays, **named})  # type: ignore[arg-type]  # numpy's stub takes a flag by that name
    return out.getvalue()


WRITERS: Mapping[str, Callable[[Mesh], bytes]] = {
    "ply": _ply,
    "obj": _obj,
    "off": _off,
    "stl": _stl,
    "glb": _glb,
    "npz": _npz,
}
"""By suffix: the file as bytes."""
