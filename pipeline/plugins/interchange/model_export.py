"""Export frames of a shot as mesh files: sequences of PLY and OBJ, stills of GLB and STL.

renders/<shot>/models/<shot>.0001.ply         a frame
renders/<shot>/models/<shot>.ply.keys.json    what each was made from
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Faces, Indices, Vectors
from pipeline.errors import FrameError, MeshError, UsageError
from pipeline.mesh import TriangleMesh
from pipeline.mesh.normals import NORMAL, unit
from pipeline.plugins.interchange.exported_frame import (
    ExportedFrame,
    KeyedFiles,
    frame_key,
    preview_surface,
    stored_frame,
)
from pipeline.plugins.interchange.mesh_writers import write_mesh
from pipeline.plugins.interchange.print_model import LONGEST_SIDE, PrintReport, print_model
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Key, Store, key_of
from render.base.atomic_write import disk_errors
from render.base.serialise import to_plain
from render.scene.materials import Material
from render.scene.rgb_spaces import srgb_of_linear


def write_ply(path: Path, frame: ExportedFrame) -> None:
    """Write points and triangles with one number a property, as other programs read them.

    x y z nx ny nz  double; the normal of a vertex at a crease is the mean of its sides
    velocity_x …    float, scene units per second
    rest_x …        float, scene units
    red green blue  uchar, sRGB, where colours vary
    linear_red …    float, the same colours, linear Rec.709
    radius          float, of a point cloud
    copy            int, of a subject with copies: the number of the copy, from 1 on

    Raises MachineError where the disk refuses.
    """
    attributes: dict[str, AnyArray] = {} if frame.radii is not None else {NORMAL: point_normals(frame)}
    attributes["velocity"] = frame.velocities.astype(np.float32)
    attributes["rest"] = frame.rest.astype(np.float32)
    if frame.colours is not None:
        shown = np.rint(255.0 * np.clip(srgb_of_linear(frame.colours), 0.0, 1.0)).astype(np.uint8)
        for prefix, colours in (("", shown), ("linear_", frame.colours.astype(np.float32))):
            attributes |= {
                f"{prefix}{name}": colours[:, k] for k, name in enumerate(("red", "green", "blue"))
            }
    if frame.radii is not None:
        attributes["radius"] = frame.radii.astype(np.float32)
    if frame.copies is not None:
        attributes["copy"] = frame.copies
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
    """Write a surface with normals, material, texture coordinates, colours, _VELOCITY and _REST, all float32.

    Vertices are split at creases and at seams of texture coordinates, for glTF has one normal and one pair of
    coordinates a vertex. Raises MachineError where the disk refuses.
    """
    import trimesh

    corner, faces = _split_corners(frame)
    source, normal = frame.faces.reshape(-1)[corner], frame.corner_normals.reshape(-1)[corner]
    surface = preview_surface(look)
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*(surface.colour if frame.colours is None else (1.0, 1.0, 1.0)), surface.opacity],
        metallicFactor=surface.metallic,
        roughnessFactor=surface.roughness,
        alphaMode=None if surface.opacity == 1.0 else "BLEND",
    )
    attributes = {"_VELOCITY": frame.velocities[source], "_REST": frame.rest[source]}
    if frame.colours is not None:
        attributes["_COLOR_0"] = np.hstack([frame.colours[source], np.ones((len(source), 1))])
    if frame.texture is not None:  # glTF counts downwards
        attributes["_TEXCOORD_0"] = frame.texture.reshape(-1, 2)[corner] * (1.0, -1.0) + (0.0, 1.0)
    model = trimesh.Trimesh(
        frame.points[source],
        faces,
        vertex_normals=frame.normals[normal],
        visual=trimesh.visual.TextureVisuals(material=material),
        vertex_attributes={name: values.astype(np.float32) for name, values in attributes.items()},
        process=False,
    )
    content = model.export(file_type="glb", include_normals=True, tree_postprocessor=_name_attributes)
    with disk_errors(path):
        path.write_bytes(bytes(content))


def _name_attributes(tree: dict[str, Any]) -> None:
    """Give colours and texture coordinates their names in glTF; trimesh rounds what it knows to 8 bits."""
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            for name in ("COLOR_0", "TEXCOORD_0"):
                if f"_{name}" in primitive["attributes"]:
                    primitive["attributes"][name] = primitive["attributes"].pop(f"_{name}")


def _split_corners(frame: ExportedFrame) -> tuple[Indices, Faces]:
    """Return vertices (N,), each a corner of a face, and faces (F, 3) of them.

    Corners with the same normal, and so the same vertex, and the same texture coordinates are one vertex.
    """
    normals = frame.corner_normals.reshape(-1)
    if frame.texture is None:
        some_corner: Indices = np.zeros(len(frame.normals), np.int32)
        some_corner[normals] = np.arange(len(normals), dtype=np.int32)
        return some_corner, frame.corner_normals
    rows = np.column_stack([normals, frame.texture.reshape(-1, 2)])
    _, corner, vertex = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return corner.astype(np.int32), vertex.astype(np.int32).reshape(-1, 3)


def point_normals(frame: ExportedFrame) -> Vectors:
    """Return unit normals (V, 3) of the vertices: the mean of the sides of a crease."""
    vertex = np.zeros(len(frame.normals), np.int32)
    vertex[frame.corner_normals.reshape(-1)] = frame.faces.reshape(-1)
    sums = np.zeros_like(frame.points)
    np.add.at(sums, vertex, frame.normals)
    return unit(sums)


def _lines(form: str, rows: AnyArray) -> str:
    """Return a line of text for each row of numbers, float32 or whole."""
    held = rows.astype(np.float32) if rows.dtype.kind == "f" else rows
    values: Iterable[Any] = map(tuple, held.tolist())
    return "".join(f"{form % row}\n" for row in values)


STILLS = ("glb", "stl")  # formats that hold one frame


def require_still(form: str, frames: str | None, count: int) -> None:
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
        with self.files.noting():
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

    def _key(self, number: int) -> Key:
        more = {"stl": self.longest, "glb": to_plain(self.request.shot.picture.look)}.get(self.form)
        return key_of(frame_key(self.request, number), self.form, more)

    def _file(self, number: int) -> str:
        return f"{self._name}.{number:04d}.{self.form}"
