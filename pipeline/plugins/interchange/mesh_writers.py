"""Write meshes, each format as exactly as it can hold the numbers."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from flowsculpt import MeshError, PolygonMesh, TriangleMesh, vertex_normals
from flowsculpt.api.files import atomic_write
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.pipeline.plugins.interchange.stl_files import TRIANGLE

_PLY_TYPES = {"f8": "double", "f4": "float", "i4": "int", "i2": "short", "i1": "char", "u1": "uchar"}

NORMAL = "normal"
"""Name of the vertex attribute (V, 3) with normals."""

UV = "uv"
"""Name of the vertex attribute (V, 2) with texture coordinates, 0 to 1 to the right and upwards."""

_COMPONENTS = {NORMAL: ("nx", "ny", "nz"), UV: ("s", "t")}

Mesh: TypeAlias = TriangleMesh | PolygonMesh


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a surface in the format of the suffix; a failed write leaves the old file.

    ply   binary, float64, with the vertex attributes, one number a property: name_x, name_y, …; nx, ny, nz;
          s, t
    obj   text that reads back as the same float64; with the attributes `normal` and `uv`, if there are any
    off   text that reads back as the same float64
    stl   binary, float32, loose triangles
    glb   float32, with vertex normals, and the attribute `uv`, if there is one
    npz   float64: vertices, faces, creases and each attribute as `attribute:<name>`

    `normal` is (V, 3); `uv`, texture coordinates to the right and upwards, is (V, 2). Polygons stay polygons
    in PLY, OBJ and OFF; the other formats get triangles.

    Raises MeshError for another suffix and where `normal` or `uv` has another shape, and MachineError where
    the file cannot be written.
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
    count_type, faces = _ply_faces(offsets, corners)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {_PLY_TYPES[rows.dtype[name].str[1:]]} {name}" for name in columns]
    header += [f"element face {len(offsets) - 1}", f"property list {count_type} int vertex_indices"]
    header += ["end_header", ""]
    return "\n".join(header).encode("ascii", "replace") + rows.tobytes() + faces


def _faces(mesh: Mesh) -> tuple[Indices, Indices]:
    """Return the start of each face's corners (F + 1,), and all corners."""
    if isinstance(mesh, PolygonMesh):
        return mesh.offsets, mesh.corners
    return np.arange(0, mesh.faces.size + 1, 3, dtype=np.int32), mesh.faces.reshape(-1)


def _ply_faces(offsets: Indices, corners: Indices) -> tuple[str, bytes]:
    """Return the faces as PLY lists, and the type of their lengths."""
    sides = np.diff(offsets)
    kind, word = ("<u1", "uchar") if sides.max(initial=0) < 256 else ("<i4", "int")
    counts = sides.astype(kind)
    raw = np.zeros(counts.nbytes + 4 * len(corners), np.uint8)
    starts = 4 * offsets[:-1] + counts.itemsize * np.arange(len(sides))
    count_bytes = (starts[:, None] + np.arange(counts.itemsize)).reshape(-1)
    corner_bytes = np.ones(len(raw), bool)
    corner_bytes[count_bytes] = False
    raw[count_bytes], raw[corner_bytes] = counts.view(np.uint8), corners.astype("<i4").view(np.uint8)
    return word, raw.tobytes()


def _face_lists(mesh: Mesh) -> Iterator[list[int]]:
    """Yield the corners of each face."""
    offsets, corners = _faces(mesh)
    for start, end in pairwise(offsets.tolist()):
        yield corners[start:end].tolist()


def _ply_type(values: np.ndarray) -> str:
    """Return the type of a property: its own if the format has it, otherwise the next that holds it."""
    own = values.dtype.str[1:]
    kept = own if own in _PLY_TYPES else "u1" if values.dtype.kind == "b" else "f8"
    return f"<{kept}" if kept[1] != "1" else kept


def _scalars(attributes: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield attributes one number a vertex at a time, since readers of PLY do not understand lists."""
    for name, values in attributes.items():
        word = "_".join(name.split()) or "attribute"
        if values.ndim == 1:
            yield word, values
            continue
        flat = values.reshape(len(values), -1)
        names = tuple(f"{word}_{c}" for c in ("xyz" if flat.shape[1] == 3 else range(flat.shape[1])))
        yield from zip(_COMPONENTS.get(name, names), flat.T, strict=False)


def _obj(mesh: Mesh) -> bytes:
    out = io.StringIO()
    out.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    normals, uvs = _attribute(mesh, NORMAL, 3), _attribute(mesh, UV, 2)
    if uvs is not None:
        out.writelines(f"vt {u!r} {v!r}\n" for u, v in uvs.tolist())
    if normals is not None:
        out.writelines(f"vn {x!r} {y!r} {z!r}\n" for x, y, z in normals.tolist())
    corner = "{0}" if uvs is None and normals is None else "{0}/" if uvs is None else "{0}/{0}"
    corner += "" if normals is None else "/{0}"
    out.writelines(f"f {' '.join(corner.format(v + 1) for v in face)}\n" for face in _face_lists(mesh))
    out.writelines(f"t crease 2/1/0 {a} {b} 10\n" for a, b in mesh.creases.tolist())
    return out.getvalue().encode()


def _attribute(mesh: Mesh, name: str, width: int) -> Floats | None:
    """Return a vertex attribute (V, width), or None. Raises MeshError where it has another shape."""
    values = mesh.attributes.get(name)
    if values is not None and values.shape[1:] != (width,):
        raise MeshError(f"attribute {name!r} has shape {values.shape}; it must be ({len(values)}, {width})")
    return None if values is None else values.astype(np.float64)


def _off(mesh: Mesh) -> bytes:
    out = io.StringIO()
    out.write(f"OFF\n{len(mesh.vertices)} {len(_faces(mesh)[0]) - 1} 0\n")
    out.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    out.writelines(f"{len(face)} {' '.join(map(str, face))}\n" for face in _face_lists(mesh))
    return out.getvalue().encode()


def _stl(mesh: Mesh) -> bytes:
    mesh = _triangles(mesh)
    rows = np.zeros(len(mesh.faces), TRIANGLE)
    rows["normal"], rows["corners"] = mesh.face_normals, mesh.vertices[mesh.faces]
    return bytes(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def _glb(mesh: Mesh) -> bytes:
    mesh = _triangles(mesh)
    if not len(mesh.faces):
        raise MeshError("a GLB without a face is not valid; write a PLY")
    from flowsculpt.pipeline.plugins.interchange.gltf_content import GltfContent  # with all materials

    content = GltfContent(plain=True)
    attributes = {
        "POSITION": content.floats(mesh.vertices, "VEC3", bounded=True),
        "NORMAL": content.floats(_shading(mesh), "VEC3"),
    }
    uvs = _attribute(mesh, UV, 2)
    if uvs is not None:
        attributes["TEXCOORD_0"] = content.floats(np.column_stack([uvs[:, 0], 1.0 - uvs[:, 1]]), "VEC2")
    plain = {"pbrMetallicRoughness": {"metallicFactor": 0.0}}  # without any it would be metal
    material = content.append("materials", plain)
    primitive = {"attributes": attributes, "indices": content.indices(mesh.faces), "material": material}
    content.append("nodes", {"mesh": content.append("meshes", {"primitives": [primitive]})})
    return content.glb("the model", "model")


def _triangles(mesh: Mesh) -> TriangleMesh:
    return mesh if isinstance(mesh, TriangleMesh) else mesh.triangulated()


def _shading(mesh: TriangleMesh) -> Floats:
    """Return a unit normal (V, 3) for every vertex: its own, or else the mean of the surrounding faces."""
    smooth = vertex_normals(mesh)
    own = mesh.attributes.get(NORMAL)
    if own is not None:
        known = np.linalg.norm(own, axis=1) > 0.5
        smooth[known] = own[known] / np.linalg.norm(own[known], axis=1, keepdims=True)
    return smooth


def _npz(mesh: Mesh) -> bytes:
    mesh = _triangles(mesh)
    out = io.BytesIO()
    named: dict[str, Any] = {f"attribute:{name}": values for name, values in mesh.attributes.items()}
    np.savez(out, vertices=mesh.vertices, faces=mesh.faces, creases=mesh.creases, **named)
    return out.getvalue()


WRITERS: Mapping[str, Callable[[Mesh], bytes]] = {
    "ply": _ply,
    "obj": _obj,
    "off": _off,
    "stl": _stl,
    "glb": _glb,
    "npz": _npz,
}
"""By suffix: a function that returns the file as bytes."""
