"""Writing meshes: each format as exactly as it can hold the numbers, and never half a file."""

from __future__ import annotations

import io
import json
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import MachineError, MeshError
from pipeline.mesh.normals import NORMAL, face_normals, vertex_normals
from pipeline.mesh.triangles import TriangleMesh

_PLY_TYPES = {"f8": "double", "f4": "float", "i4": "int", "i2": "short", "i1": "char", "u1": "uchar"}
_COMPONENTS = {NORMAL: ("nx", "ny", "nz")}
_FLOAT, _UNSIGNED, _VERTICES, _INDICES = 5126, 5125, 34962, 34963  # glTF's names for types and uses


def write_mesh(mesh: TriangleMesh, path: str | Path) -> None:
    """Write a surface in the format of the suffix, under a temporary name first.

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
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.write_bytes(writer(mesh))
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise MachineError(f"{path}: cannot be written: {error.strerror}") from error


def _ply(mesh: TriangleMesh) -> bytes:
    columns = {"x": mesh.vertices[:, 0], "y": mesh.vertices[:, 1], "z": mesh.vertices[:, 2]}
    columns |= {name: values for name, values in _scalars(mesh.attributes) if name not in columns}
    rows = np.empty(len(mesh.vertices), [(name, _ply_type(values)) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {_PLY_TYPES[rows.dtype[name].str[1:]]} {name}" for name in columns]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(header).encode("ascii", "replace") + rows.tobytes() + faces.tobytes()


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


def _obj(mesh: TriangleMesh) -> bytes:
    out = io.StringIO()
    out.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    normals = mesh.attributes.get(NORMAL)
    if normals is not None:
        out.writelines(f"vn {x!r} {y!r} {z!r}\n" for x, y, z in normals.tolist())
        out.writelines(f"f {a}//{a} {b}//{b} {c}//{c}\n" for a, b, c in (mesh.faces + 1).tolist())
    else:
        out.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist())
    return out.getvalue().encode()


def _off(mesh: TriangleMesh) -> bytes:
    out = io.StringIO()
    out.write(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n")
    out.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    out.writelines(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist())
    return out.getvalue().encode()


def _stl(mesh: TriangleMesh) -> bytes:
    rows = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["normal"], rows["corners"] = face_normals(mesh), mesh.vertices[mesh.faces]
    return b"flowsculpt".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def _glb(mesh: TriangleMesh) -> bytes:
    """glTF 2.0, binary: a JSON chunk that describes the chunk of numbers behind it."""
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


def _npz(mesh: TriangleMesh) -> bytes:
    out = io.BytesIO()
    named = {f"attribute:{name}": values for name, values in mesh.attributes.items()}
    arrays: dict[str, AnyArray] = {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases}
    np.savez(out, **{**arrays, **named})  # type: ignore[arg-type]  # numpy's stub takes a flag by that name
    return out.getvalue()


WRITERS: Mapping[str, Callable[[TriangleMesh], bytes]] = {
    "ply": _ply,
    "obj": _obj,
    "off": _off,
    "stl": _stl,
    "glb": _glb,
    "npz": _npz,
}
"""By suffix: the file as bytes."""
