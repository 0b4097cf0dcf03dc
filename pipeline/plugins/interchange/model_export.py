"""Export frames of a shot as mesh files: sequences of PLY and OBJ, stills of GLB and STL.

renders/<shot>/models/<shot>.0001.ply         a frame
renders/<shot>/models/<shot>.ply.keys.json    what each was made from

The report of a model to be printed has its thinnest wall, estimated by rays from faces against their normals,
up to where they leave the body again. Rays are intersected with triangles as by T. Möller and B. Trumbore,
"Fast, minimum storage ray-triangle intersection", Journal of Graphics Tools 2(1), 1997.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import FrameError, MeshError, TriangleMesh, UsageError, mesh_statistics, validate
from flowsculpt.api.files import disk_errors, to_plain
from flowsculpt.api.flows import TriangleTree
from flowsculpt.api.frames import RenderRequest, Store, key_of
from flowsculpt.api.materials import Material, srgb_of_linear
from flowsculpt.api.meshes import Floats
from flowsculpt.api.options import Frames
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import split_corners
from flowsculpt.pipeline.plugins.interchange.exported_frame import (
    ExportedFrame,
    KeyedFiles,
    frame_key,
    stored_frame,
)
from flowsculpt.pipeline.plugins.interchange.exported_materials import pictures_recipe
from flowsculpt.pipeline.plugins.interchange.gltf_content import GltfContent
from flowsculpt.pipeline.plugins.interchange.mesh_writers import NORMAL, write_mesh

RAYS = 4000  # the most faces that rays start from, chosen evenly


def wall_thickness(mesh: TriangleMesh) -> Floats:
    """Return distances through the body of a closed mesh, (R,), in its units, from R of its faces.

    Infinite where a ray does not meet the surface again. No wall is thicker than the distances at its faces.
    """
    normals, corners = mesh.face_normals, mesh.vertices[mesh.faces]
    sound = np.flatnonzero(np.linalg.norm(normals, axis=1) > 0.5)  # a face without area has no normal
    starts = sound[np.linspace(0, len(sound) - 1, min(RAYS, len(sound))).astype(int)]
    return _distances(TriangleTree.of(corners), corners[starts].mean(axis=1), -normals[starts], starts)


def _distances(tree: TriangleTree, origins: Floats, directions: Floats, starts: np.ndarray) -> Floats:
    """Return how far rays go until they meet a triangle, (R,), infinite where they meet none.

    starts  (R,) the triangle that each starts on, which does not count

    All rays go down the tree together, a level at a time.
    """
    boxes = tree.memory[: tree.triangles].reshape(-1, 8)
    triangles = tree.memory[tree.triangles :].reshape(-1, 3, 3)
    nearest = np.full(len(starts), np.inf)
    ray, box = np.arange(len(starts)), np.zeros(len(starts), np.int64)
    while len(ray):
        kept = _entries(origins[ray], directions[ray], boxes[box]) < nearest[ray]
        ray, box = ray[kept], box[kept]
        is_leaf = boxes[box, 7] > 0
        first, end = tree.ranges[box[is_leaf]].T
        counts = end - first
        of_leaf = np.repeat(ray[is_leaf], counts)
        triangle = np.arange(len(of_leaf)) + np.repeat(first - np.cumsum(counts) + counts, counts)
        other = tree.order[triangle] != starts[of_leaf]
        of_leaf, triangle = of_leaf[other], triangle[other]
        np.minimum.at(nearest, of_leaf, _hits(triangles[triangle], origins[of_leaf], directions[of_leaf]))
        ray, parent = ray[~is_leaf], box[~is_leaf]
        second = boxes[parent, 6].astype(np.int64)
        ray, box = np.concatenate([ray, ray]), np.concatenate([parent + 1, second])
    return nearest


def _entries(origins: Floats, directions: Floats, boxes: Floats) -> Floats:
    """Return where rays (N,) enter their boxes, infinite where they miss them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (boxes[:, :3] - origins) / directions
        high = (boxes[:, 3:6] - origins) / directions
    first = np.nanmax(np.minimum(low, high), axis=1)
    last = np.nanmin(np.maximum(low, high), axis=1)
    return np.where((last >= first) & (last >= 0.0), first, np.inf)


def _hits(triangles: Floats, origins: Floats, directions: Floats) -> Floats:
    """Return where rays (N,) meet their triangles (N, 3, 3), infinite where they miss them."""
    a, b, c = triangles.transpose(1, 0, 2)
    from_corner, across = origins - a, np.cross(directions, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", from_corner, across) / determinant
        along = np.cross(from_corner, b - a)
        v = np.einsum("ij,ij->i", directions, along) / determinant
        distance = np.einsum("ij,ij->i", c - a, along) / determinant
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return np.where(inside, distance, np.inf)


LONGEST_SIDE = 100.0  # millimetres of the longest side of a printed model


@dataclass(frozen=True)
class PrintReport:
    """Measures of a model as it is printed.

    size       width, depth and height, millimetres
    volume     cubic millimetres
    thinnest   the thinnest wall, millimetres, estimated by rays; None where none met the surface again
    thin       the wall that a hundredth of the faces are thinner than, as `thinnest`
    crossings  pairs of faces that pass through each other
    """

    size: tuple[float, float, float]
    volume: float
    triangles: int
    thinnest: float | None
    thin: float | None
    crossings: int

    @classmethod
    def of(cls, model: TriangleMesh) -> PrintReport:
        """Measure a model in millimetres, with z up."""
        low, high = model.bounds
        width, depth, height = (high - low).tolist()
        walls = wall_thickness(model)
        known = walls[np.isfinite(walls)]
        return cls(
            size=(width, depth, height),
            volume=volume_of(model.vertices, model),
            triangles=len(model.faces),
            thinnest=float(known.min()) if len(known) else None,
            thin=float(np.quantile(known, 0.01)) if len(known) else None,
            crossings=mesh_statistics(model).crossings or 0,
        )

    def in_words(self) -> str:
        """Return the report in a few sentences."""
        size = " × ".join(f"{side:.1f}" for side in self.size)
        words = f"{size} mm, {self.volume / 1000.0:.4g} cm³, {self.triangles} triangles, closed."
        if self.thinnest is not None:
            words += f" Its thinnest wall is about {self.thinnest:.2g} mm, and 1% of its faces"
            words += f" have less than {self.thin:.2g} mm below them."
        if self.crossings:
            words += f" {self.crossings} pairs of faces pass through each other; let the slicer merge them."
        return words

    def as_data(self) -> dict[str, Any]:
        """Return the report as JSON data, with its unit."""
        return {"unit": "mm", **asdict(self)}


def print_model(frame: ExportedFrame, longest: float, name: str) -> TriangleMesh:
    """Return a frame standing on z = 0 with z up, as printers have it, `longest` mm long on its longest side.

    Raises MeshError, with its name, for a point cloud, and for a surface that is not closed.
    """
    if not len(frame.faces):
        raise MeshError(f"{name}: a point cloud has no surface to print; export it as ply or usd")
    mesh = TriangleMesh(frame.points, frame.faces)
    found = validate(mesh)
    if found.problem is not None:
        raise MeshError(f"{name}: {found.problem}, so it cannot be printed; export it as ply and repair it")
    if not found.closed:
        raise MeshError(
            f"{name}: {found.boundary_edges} edges have a face on one side only; a printer needs a closed "
            "surface. Export it as ply and give it a thickness, or choose a closed subject"
        )
    x, y, z = frame.points.T
    stood = np.stack([x, -z, y], axis=1)
    low, high = stood.min(axis=0), stood.max(axis=0)
    middle = np.array([*(0.5 * (low + high))[:2], low[2]])
    points = (stood - middle) * (longest / float((high - low).max()))
    faces = mesh.faces if volume_of(points, mesh) > 0.0 else mesh.faces[:, ::-1]
    return TriangleMesh(points, faces)


def volume_of(points: Floats, mesh: TriangleMesh) -> float:
    """Return the volume that a closed mesh encloses with vertices at points (V, 3); below 0 if inside out."""
    a, b, c = points[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def write_ply(path: Path, frame: ExportedFrame) -> None:
    """Write points and triangles with one number a property, as other programs read them.

    x y z nx ny nz  double; the normal of a vertex at a crease is the mean of its sides
    crease          uchar, where there are any: 1 for such a vertex, whose normal readers do better without
    velocity_x …    float, scene units per second
    rest_x …        float, scene units
    red green blue  uchar, sRGB, where colours vary
    linear_red …    float, the same colours, linear Rec.709
    radius          float, of a point cloud
    copy            int, of a subject with copies: the number of the copy, from 1 on
    values          float, what the subject measures; NaN where that is missing

    Raises MachineError where the disk refuses.
    """
    attributes: dict[str, np.ndarray] = {} if frame.radii is not None else {NORMAL: point_normals(frame)}
    attributes["velocity"] = frame.velocities.astype(np.float32)
    attributes["rest"] = frame.rest.astype(np.float32)
    if frame.colours is not None:
        shown = np.rint(255.0 * np.clip(srgb_of_linear(frame.colours), 0.0, 1.0)).astype(np.uint8)
        for prefix, colours in (("", shown), ("linear_", frame.colours.astype(np.float32))):
            attributes |= {
                f"{prefix}{name}": colours[:, k] for k, name in enumerate(("red", "green", "blue"))
            }
    if frame.copies is not None:
        attributes["copy"] = frame.copies
    if frame.values is not None:
        attributes["values"] = frame.values.astype(np.float32)
    if frame.radii is not None:
        attributes["radius"] = frame.radii.astype(np.float32)
    elif frame.corner_normals.max(initial=0) >= len(frame.points):
        attributes["crease"] = np.bincount(_vertex_of(frame), minlength=len(frame.points)) > 1
    write_mesh(TriangleMesh(frame.points, frame.faces, attributes), path)


def write_obj(path: Path, frame: ExportedFrame) -> None:
    """Write text with a normal for each corner, texture coordinates where there are any, and colours.

    Colours stand after the coordinates of a vertex, in sRGB; creases as tags of OpenSubdiv, which our reader
    reads. Numbers have nine digits, which hold float32. Raises MachineError where the disk refuses.
    """
    points = frame.points
    if frame.colours is not None:
        points = np.hstack([points, srgb_of_linear(frame.colours)])
    lines = [_lines("v" + " %.9g" * points.shape[1], points)]
    corners = [frame.faces]
    if frame.texture is not None:
        lines.append(_lines("vt %.9g %.9g", frame.texture.reshape(-1, 2)))
        corners.append(np.arange(frame.faces.size, dtype=np.int32).reshape(-1, 3))
    lines.append(_lines("vn %.9g %.9g %.9g", frame.normals))
    corners.append(frame.corner_normals)
    corner = " %d/%d/%d" if frame.texture is not None else " %d//%d"
    lines.append(_lines("f" + 3 * corner, np.stack(corners, axis=2).reshape(len(frame.faces), -1) + 1))
    lines += [f"t crease 2/1/0 {a} {b} 10\n" for a, b in frame.creases.tolist()]
    with disk_errors(path):
        path.write_text("".join(lines), encoding="ascii")


def write_glb(path: Path, frame: ExportedFrame, look: Material) -> None:
    """Write a surface with normals, texture coordinates, colours, _VELOCITY and _REST, all float32, and its
    materials with their pictures. Of a subject that measures something, also _VALUES, and _KNOWN, 1 or 0.

    Vertices are split at creases and at seams of texture coordinates, for glTF has one normal and one pair of
    coordinates a vertex. Raises MachineError where the disk refuses.
    """
    paint = frame.paint
    painted = None if paint is None else paint.colours
    corner, faces = split_corners(frame.corner_normals, frame.texture, painted)
    source, normal = frame.faces.reshape(-1)[corner], frame.corner_normals.reshape(-1)[corner]
    content = GltfContent(plain=True)
    attributes = {
        "POSITION": content.floats(frame.points[source], "VEC3", bounded=True),
        "NORMAL": content.floats(frame.normals[normal], "VEC3"),
        "_VELOCITY": content.floats(frame.velocities[source], "VEC3"),
        "_REST": content.floats(frame.rest[source], "VEC3"),
    }
    if frame.values is not None:  # glTF has no NaN
        known = np.isfinite(frame.values)
        for name, values in (("_VALUES", np.where(known, frame.values, 0.0)), ("_KNOWN", known)):
            attributes[name] = content.floats(values[source, None].astype(np.float64), "SCALAR")
    colours: np.ndarray | None = None if frame.colours is None else frame.colours[source]
    if painted is not None:
        colours = painted.reshape(-1, 3)[corner]
    if colours is not None:
        opaque = np.hstack([colours, np.ones((len(source), 1))])
        attributes["COLOR_0"] = content.floats(opaque, "VEC4")
    if frame.texture is not None:  # glTF counts downwards
        downwards = frame.texture.reshape(-1, 2)[corner] * (1.0, -1.0) + (0.0, 1.0)
        attributes["TEXCOORD_0"] = content.floats(downwards, "VEC2")
    primitives = content.primitives(attributes, faces, None if paint is None else paint.materials, look)
    mesh = content.append("meshes", {"name": "sculpture", "primitives": primitives})
    content.append("nodes", {"name": "sculpture", "mesh": mesh})
    content.write(path, "sculpture")


def _vertex_of(frame: ExportedFrame) -> np.ndarray:
    """Return the vertex (N,) of each normal."""
    vertex = np.zeros(len(frame.normals), np.int32)
    vertex[frame.corner_normals.reshape(-1)] = frame.faces.reshape(-1)
    return vertex


def point_normals(frame: ExportedFrame) -> Floats:
    """Return unit normals (V, 3) of the vertices: the mean of the sides of a crease."""
    sums = np.zeros_like(frame.points)
    np.add.at(sums, _vertex_of(frame), frame.normals)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return sums / np.where(lengths > 0.0, lengths, 1.0)


def _lines(form: str, rows: np.ndarray) -> str:
    """Return a line of text for each row of numbers, float32 or whole."""
    held = rows.astype(np.float32) if rows.dtype.kind == "f" else rows
    values: Iterable[Any] = map(tuple, held.tolist())
    return "".join(f"{form % row}\n" for row in values)


STILLS = ("glb", "stl")  # formats that hold one frame


def require_still(form: str, frames: Frames, count: int) -> None:
    """Raise UsageError where a form that holds a still is asked for so many frames."""
    if form in STILLS and count != 1:
        asked = f"-f {frames} is {count} frames" if frames else "no frame is chosen"
        raise UsageError(
            f"{asked}, and {form.upper()} holds one; choose it with -f, as in -f 12. usd, ply and obj take a "
            "range"
        )


@dataclass(frozen=True, eq=False)
class ModelExport:
    """Frames of a shot as files of one form. Files that are current are kept.

    longest  millimetres of the longest side of a model to be printed
    """

    request: RenderRequest
    store: Store
    folder: Path
    form: str
    longest: float = LONGEST_SIDE

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self._name}.{self.form}.keys.json", self.store)

    @property
    def _name(self) -> str:
        """The name of the shot in files, with that of its subject if it has several."""
        return self.request.motion_folders.part_name

    @property
    def path(self) -> Path:
        """The path of the file, or the folder of several."""
        numbers = self.request.requested
        return self.folder / self._file(numbers[0]) if len(numbers) == 1 else self.folder

    def stale(self) -> list[int]:
        """Return the frames whose files are missing, damaged, or of an earlier shot."""
        numbers = sorted(self.request.requested)
        return [n for n in numbers if not self.files.is_current(self._file(n), self._key(n))]

    def shown(self) -> list[int]:
        """Return the frames whose files are current, in ascending order."""
        return sorted(set(self.request.requested).difference(self.stale()))

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the files that are not current, and return messages of failed frames; `passed` follows each.

        Raises MachineError where the disk refuses, MeshError for a model that cannot be printed, or has no
        surface that GLB could hold.
        """
        faults = []
        with self.files.changing():
            for number in self.stale():
                try:
                    frame = stored_frame(self.request, self.store, number)
                    self.files.write(self._file(number), self._key(number), self._writer(number, frame))
                except FrameError as error:
                    faults.append(f"{self._name} {error.of(number)}")
                passed()
        return faults

    def print_report(self) -> PrintReport | None:
        """Return the measures of the model to be printed; None for other forms. Raises as `write`."""
        if self.form != "stl":
            return None
        (number,) = self.request.requested
        frame = stored_frame(self.request, self.store, number)
        return PrintReport.of(print_model(frame, self.longest, f"{self._name} frame {number}"))

    def _writer(self, number: int, frame: ExportedFrame) -> Callable[[Path], object]:
        """Return the function that writes a frame to a path. Raises MeshError for a frame of no such form."""
        name, look = f"{self._name} frame {number}", self.request.shot.picture.look
        if self.form == "stl":
            model = print_model(frame, self.longest, name)
            return lambda path: write_mesh(model, path)
        if not len(frame.faces) and self.form != "ply":
            raise MeshError(f"{name}: a point cloud has no surface for {self.form}; export it as ply or usd")
        if self.form == "glb":
            return lambda path: write_glb(path, frame, look)
        write = {"ply": write_ply, "obj": write_obj}[self.form]
        return lambda path: write(path, frame)

    def _key(self, number: int) -> str:
        look = self.request.shot.picture.look
        more = {"stl": self.longest, "glb": to_plain(look)}.get(self.form)
        pictures = pictures_recipe(look) if self.form == "glb" else []
        return key_of(frame_key(self.request, number), self.form, more, *pictures)

    def _file(self, number: int) -> str:
        return f"{self._name}.{number:04d}.{self.form}"
