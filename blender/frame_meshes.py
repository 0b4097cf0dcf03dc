# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of simulated frames as data blocks of Blender, one for each key.

A stored mesh never changes, so a data block is built once; showing a frame is giving it to the object. Data
blocks are looked up by name, since an undo step replaces them.
"""

from __future__ import annotations

from collections import OrderedDict
from zipfile import BadZipFile

import bpy
import numpy as np

PREFIX = ".flowsculpt "  # names that begin with a point are hidden in lists

EMPTY = PREFIX + "nothing"

_shown: OrderedDict[str, int] = OrderedDict()
"""Estimated bytes of data blocks by their keys, those shown last at the end."""


def is_loaded(key: str) -> bool:
    """Tell whether the mesh of a key was loaded; looking it up among many data blocks would take longer."""
    return key in _shown


def frame_mesh(key: str, file: str) -> bpy.types.Mesh | None:
    """Return the mesh of a key, from memory or its file; None where the file is not there yet."""
    mesh = bpy.data.meshes.get(PREFIX + key)
    if mesh is None:
        try:
            with np.load(file) as arrays:
                mesh = _build_mesh(PREFIX + key, dict(arrays))
        except (OSError, ValueError, KeyError, BadZipFile):
            return None  # not simulated, or just being replaced
    _shown[key] = 200 * len(mesh.vertices)
    _shown.move_to_end(key)
    return mesh


def nothing() -> bpy.types.Mesh:
    """Return a mesh without vertices, for frames that are not simulated."""
    return bpy.data.meshes.get(EMPTY) or _new(EMPTY)


def _new(name: str) -> bpy.types.Mesh:
    """Return a new mesh with a slot for a material, which objects fill: it stays in all frames."""
    mesh = bpy.data.meshes.new(name)
    mesh.materials.append(None)
    return mesh


def bytes_loaded() -> int:
    """Return about how much memory the meshes take."""
    return sum(_shown.values())


def has_room(most: int) -> bool:
    """Tell whether one more mesh as large as the largest fits into so many bytes."""
    return bytes_loaded() + max(_shown.values(), default=0) <= most


def forget_beyond(most: int) -> None:
    """Remove the meshes shown longest ago until the others take at most so many bytes."""
    while len(_shown) > 1 and bytes_loaded() > most:
        key, _ = _shown.popitem(last=False)
        mesh = bpy.data.meshes.get(PREFIX + key)
        if mesh is not None and mesh.users == 0:
            bpy.data.meshes.remove(mesh)


def forget_all() -> None:
    """Remove all meshes that no object shows."""
    _shown.clear()
    for mesh in [mesh for mesh in bpy.data.meshes if mesh.name.startswith(PREFIX) and mesh.users == 0]:
        bpy.data.meshes.remove(mesh)


def _build_mesh(name: str, arrays: dict[str, np.ndarray]) -> bpy.types.Mesh:
    """Build a data block of the arrays of a mesh file."""
    points, starts, corners, creases = _polygons(arrays)
    mesh = _new(name)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    if len(corners):
        mesh.loops.add(len(corners))
        mesh.loops.foreach_set("vertex_index", corners)
        mesh.polygons.add(len(starts))
        mesh.polygons.foreach_set("loop_start", starts)
    mesh.update(calc_edges=True)
    if len(corners):
        mesh.shade_smooth()
        if len(creases):
            _sharpen(mesh, creases)
    return mesh


def _polygons(arrays: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """Return points (V, 3), starts of polygons (P,), corners (C,) and hard edges (K, 2) of a mesh file."""
    points, creases = arrays["vertices"], np.asarray(arrays.get("creases", ()), np.int64).reshape(-1, 2)
    if "offsets" in arrays:
        starts, corners = arrays["offsets"][:-1], arrays["corners"]
    else:
        faces = arrays["faces"]
        starts, corners = np.arange(0, faces.size, faces.shape[1]), faces.ravel()
    if "copies" in arrays:  # of one surface around its middle: turn and size, then place
        turns, places = arrays["copies"][:, :, :3], arrays["copies"][:, :, 3]
        copies, count = np.arange(len(places))[:, None], len(points)
        points = (np.einsum("nij,vj->nvi", turns, points) + places[:, None]).reshape(-1, 3)
        starts = (starts + copies * len(corners)).ravel()
        corners = (corners + copies * count).ravel()
        creases = (creases + copies[:, None] * count).reshape(-1, 2)
    return points, starts.astype(np.int32), corners.astype(np.int32), creases


def _sharpen(mesh: bpy.types.Mesh, creases: np.ndarray) -> None:
    """Mark the edges between pairs of vertices (K, 2) as sharp."""
    ends = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", ends)
    count = len(mesh.vertices)
    names, wanted = (
        np.sort(pairs, axis=1) @ (count, 1) for pairs in (ends.reshape(-1, 2).astype(np.int64), creases)
    )
    sharp = mesh.attributes.get("sharp_edge") or mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    sharp.data.foreach_set("value", np.isin(names, wanted))
