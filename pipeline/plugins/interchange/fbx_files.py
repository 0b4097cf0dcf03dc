"""Models in FBX files, text or binary of any version, which ufbx reads in a process of its own.

ufbx is C that could crash on a damaged file. The process answers with an axis, or with a line of JSON, which
is empty for a surface that follows. ufbx 0.0.5 crashes where an attribute is asked for that it does not have,
as numpy.asarray does; so lists are read as buffers.
"""

from __future__ import annotations

import ctypes
import gc
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import quote
from flowsculpt.api.files import InputFile, Parser, text_content
from flowsculpt.api.meshes import FileSurface, Floats, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    PlacedMeshes,
    Polygons,
    answered,
    asked,
    bound_note,
    cages_note,
    joined,
    known_unit,
    one_file,
    packed_surface,
    require_package,
    unpacked_surface,
)

if TYPE_CHECKING:
    import ufbx

_MODULE = "flowsculpt.pipeline.plugins.interchange.fbx_files"


def read_fbx(path: Path) -> FileSurface:
    """Read the visible meshes of an FBX file as one surface, in its coordinates and units.

    Axes other than y up and z up, both right-handed, are turned to y up. Raises MachineError without ufbx,
    ValueError or MeshError where it cannot be read.
    """
    require_ufbx()
    return unpacked_surface(asked(_MODULE, path, "surface"))


def _up_of(path: Path, digest: str) -> str:
    """Return the axis that points up in the coordinates of `read_fbx`; the disk cache stores it by digest."""
    require_ufbx()
    return Parser(_MODULE).answer_about_content(path, digest, "ufbx", "up")


def require_ufbx() -> None:
    require_package("FBX files", "ufbx", "ufbx (4 MB)", "models")


FBX = SurfaceReader(read_fbx, one_file(_up_of), states_up=True)

MOST_BYTES = 1 << 30  # size of the largest file

_BINARY = b"Kaydara FBX Binary"

_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
"""The vectors of ufbx's CoordinateAxis: ±x, ±y, ±z."""

_SCENES: list[Any] = []  # the scenes that were read, which ufbx 0.0.5 cannot free without a crash


def counted(element: Any) -> Any:
    """Return an object of ufbx, which every access must pass: 0.0.5 counts one reference too few."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(element))
    return element


@contextmanager
def uncollected() -> Iterator[None]:
    """Keep the garbage collector from the objects of ufbx, whose references it would miscount."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def answer(path: str, question: str) -> bytes:
    """Return the answer to `up` or `surface` about the file at a path."""
    Parser.allow_memory(Parser.MEMORY + 40 * InputFile(Path(path), MOST_BYTES).size())
    content = InputFile(Path(path), MOST_BYTES).content()
    if question == "up":
        return up_axis(content).encode()
    return answered(lambda: packed_surface(visible_surface(content)))


@uncollected()
def up_axis(content: bytes) -> str:
    """Return the axis that points up in the coordinates of `visible_surface`: y or z."""
    axes = _axes(loaded_scene(content, ignore_all_content=True))
    return "z" if axes is not None and axes[1, 2] == 1.0 and np.linalg.det(axes) > 0.0 else "y"


def loaded_scene(
    content: bytes, *, ignore_embedded: bool = True, ignore_animation: bool = True, **options: bool
) -> ufbx.Scene:
    """Return the scene of a file. Raises UfbxError or ValueError where it cannot be read."""
    import ufbx

    try:
        scene = ufbx.load_memory(
            content if content.startswith(_BINARY) else text_content(content),
            file_format=ufbx.FileFormat.FBX,  # it would read OBJ too
            ignore_animation=ignore_animation,
            ignore_embedded=ignore_embedded,
            use_blender_pbr_material=True,  # as metalness and roughness, as Blender reads them
            skip_mesh_parts=True,
            skip_skin_vertices=ignore_animation,
            index_error_handling=ufbx.IndexErrorHandling.NO_INDEX,
            **options,
        )
    except ufbx.UfbxError as error:
        if str(error) != "Failed to load":
            raise
        raise ValueError("its numbers contradict each other, or it ends early") from None
    _SCENES.append(scene)
    return scene


def _axes(scene: ufbx.Scene) -> Floats | None:
    """Return the directions right, up and front (3, 3) in the file's coordinates; None if it says none."""
    axes = scene.settings.axes
    numbers = [int(axes.right), int(axes.up), int(axes.front)]
    if max(numbers) >= len(_DIRECTIONS):
        return None
    return _DIRECTIONS[numbers]


@uncollected()
def visible_surface(content: bytes) -> FileSurface:
    """Return the visible meshes of a file as one surface. Raises MeshError where there is none."""
    scene = loaded_scene(content)
    meshes, cages, bound = PlacedMeshes(), 0, 0
    read: dict[int, Polygons] = {}
    for node, mesh, matrix in shown_meshes(scene, meshes.left_out):
        if mesh.element_id not in read:
            read[mesh.element_id] = polygons_of(mesh, quote(node.name or mesh.name))
        bound += len(mesh.skin_deformers) + len(mesh.blend_deformers) > 0
        cages += int(mesh.subdivision_display_mode) != 0
        meshes.add(read[mesh.element_id], matrix)
    others = meshes.left_out_words
    if not meshes.parts:
        raise MeshError(
            f"it has no visible mesh.{f' Left out: {others}.' if others else ''} "
            "Convert its objects to meshes in the program that made it."
        )
    notes = [f"left out: {others}; convert or show it in the program that made it"] if others else []
    if bound:
        notes.append(bound_note(bound))
    if cages:
        notes.append(cages_note(cages))
    return joined(meshes.parts, notes)._replace(unit=known_unit(scene.settings.unit_meters))


_SHAPES = {7: "curve", 8: "curve", 9: "NURBS surface", 10: "trimmed NURBS surface", 12: "procedural shape"}
"""Kinds of shapes that are not meshes, by ufbx's ElementType."""

_LOD_GROUP = 16


def shown_meshes(scene: ufbx.Scene, left_out: Counter[str]) -> Iterator[tuple[ufbx.Node, ufbx.Mesh, Floats]]:
    """Yield the visible meshes with their nodes, and matrices (4, 4) of row vectors; count the others."""
    turn = turn_of(scene)
    for node, is_shown in _nodes(scene):
        mesh = counted(node.mesh)
        kind = _SHAPES.get(int(node.attrib_type), "") if mesh is None else "" if is_shown else "hidden mesh"
        if kind:
            left_out[kind] += 1
        elif mesh is not None:
            matrix = np.eye(4)
            matrix[:, :3] = node.geometry_to_world  # with its pivots and geometric transform
            yield node, mesh, matrix @ turn


def turn_of(scene: ufbx.Scene) -> Floats:
    """Return the matrix (4, 4) of row vectors that turns the world of a scene to y up, if need be."""
    axes, turn = _axes(scene), np.eye(4)
    if axes is not None and not (np.linalg.det(axes) > 0.0 and max(axes[1, 1], axes[1, 2]) == 1.0):
        turn[:3, :3] = axes.T
    return turn


def _nodes(scene: ufbx.Scene) -> Iterator[tuple[ufbx.Node, bool]]:
    """Yield the nodes of a scene, each with whether it is shown; of levels of detail, the first alone."""
    import ufbx

    waiting = [(counted(scene.root_node), True)]
    while waiting:
        node, parent_shown = waiting.pop()
        inherits = ufbx.find_bool(node.props, "Visibility Inheritance", True)
        is_shown = node.visible and (parent_shown or not inherits)
        yield node, is_shown
        children = [counted(child) for child in node.children]
        if int(node.attrib_type) == _LOD_GROUP:
            children = children[:1]
        waiting += [(child, is_shown) for child in reversed(children)]


def polygons_of(mesh: ufbx.Mesh, name: str) -> Polygons:
    """Return the faces of a mesh in its own coordinates, without holes. Raises as `faces_of`."""
    points, sides, corners = faces_of(mesh, name)
    polygons = Polygons(
        points, sides, corners, _creases(mesh, points, corners, sides), _groups(mesh, len(sides))
    )
    holes = numbers_of(mesh.face_hole, np.bool_)
    return polygons.without(holes) if holes.any() else polygons


def faces_of(mesh: ufbx.Mesh, name: str) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Return the points (V, 3), numbers of corners (F,) and corners (C,) of a mesh, in its coordinates.

    Raises MeshError, with its name, where they contradict each other.
    """
    points = numbers_of(mesh.vertices, np.float64, 3)
    first, sides = numbers_of(mesh.faces, np.uint32, 2).astype(np.int64).T
    corners = numbers_of(mesh.vertex_indices, np.uint32).astype(np.int64)
    if not np.array_equal(first, np.cumsum(sides) - sides) or sides.sum() != len(corners):
        raise MeshError(f"{name}: its faces do not fit its corners")
    wrong = np.flatnonzero(corners >= len(points))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(sides), wrong[0], side="right"))
        raise MeshError(f"{name}: face {face} names a vertex that is not there; it has {len(points)}")
    return points, sides, corners


def _groups(mesh: ufbx.Mesh, faces: int) -> np.ndarray:
    """Return a number (F,) for each face: those of one material and smoothing have the same."""
    columns = [numbers_of(mesh.face_material, np.uint32), numbers_of(mesh.face_smoothing, np.bool_)]
    known = [column.astype(np.int64) for column in columns if len(column) == faces]
    if not known:
        return np.zeros(faces, np.int64)
    return np.unique(np.column_stack(known), axis=0, return_inverse=True)[1].reshape(-1)


def _creases(mesh: ufbx.Mesh, points: Floats, corners: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the edges (K, 2) that have a crease weight, and the hard ones amid smooth ones.

    Which are hard is said by smoothing of edges, or where a file has none, by its normals.
    """
    edges = corners[numbers_of(mesh.edges, np.uint32, 2).astype(np.int64)]
    weights = numbers_of(mesh.edge_crease, np.float64)
    weighted = edges[weights > 0.0] if len(weights) == len(edges) else edges[:0]
    smooth = numbers_of(mesh.edge_smoothing, np.bool_)
    if len(smooth) == len(edges) and len(edges):
        hard = edges[~smooth] if smooth.any() else edges[:0]
    else:
        hard = _parted_edges(mesh, points, corners, sides)
    return np.concatenate([weighted, hard])


_SAME_NORMAL = 0.999  # cosine between normals, from which they are the same: 2.6 degrees


def _parted_edges(mesh: ufbx.Mesh, points: Floats, corners: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the edges (K, 2) where the normals of two faces differ; none of a mesh that is shaded flat."""
    given = mesh.vertex_normal
    values, index = numbers_of(given.values, np.float64, 3), numbers_of(given.indices, np.uint32)
    none = np.empty((0, 2), np.int64)
    if len(index) != len(corners) or not len(values) or index.max() >= len(values) or sides.min() < 3:
        return none
    normals = _unit_vectors(values[index])
    offsets = np.concatenate([[0], np.cumsum(sides)])
    next_side, owners = np.arange(1, len(corners) + 1), np.repeat(np.arange(len(sides)), sides)
    next_side[offsets[1:] - 1] = offsets[:-1]
    ends = np.sort(np.column_stack([corners, corners[next_side]]))
    order = np.lexsort(ends.T)
    starts = np.flatnonzero(np.append(True, (np.diff(ends[order], axis=0) != 0).any(axis=1)))
    twice = starts[np.diff(np.append(starts, len(order))) == 2]
    a, b = order[twice], order[twice + 1]
    flips = corners[a] != corners[b]  # sides of neighbours run in opposite directions
    tails, heads = np.where(flips, next_side[b], b), np.where(flips, b, next_side[b])
    centred = points[corners] - points.mean(axis=0)
    areas = np.add.reduceat(np.cross(centred, centred[next_side]), offsets[:-1])  # Newell's
    planes = _unit_vectors(areas)[owners]
    is_bent = _dot(planes[a], planes[b]) < _SAME_NORMAL
    is_parted = (_dot(normals[a], normals[tails]) < _SAME_NORMAL) | (
        _dot(normals[next_side[a]], normals[heads]) < _SAME_NORMAL
    )
    if is_parted[is_bent].all():
        return none
    return ends[a[is_bent & is_parted]]


def _unit_vectors(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)


def _dot(a: Floats, b: Floats) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def numbers_of(values: Any, kind: Any, columns: int = 1) -> np.ndarray:
    """Return a list of ufbx as an array (N,) or (N, columns). Its lists of uint32 have no buffers."""
    if kind is np.uint32 and columns == 1:
        return np.fromiter(values, kind, len(values))
    flat = np.frombuffer(values, kind) if len(values) else np.empty(0, kind)
    return flat.reshape(-1, columns) if columns > 1 else flat


if __name__ == "__main__":
    Parser.serve(answer)
