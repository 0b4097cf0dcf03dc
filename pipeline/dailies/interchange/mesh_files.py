"""Exported frames as mesh files: PLY, OBJ and GLB, with the attributes that readers of each understand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Vectors
from pipeline.dailies.interchange.exported_frame import ExportedFrame
from pipeline.dailies.interchange.usd_materials import preview_surface
from pipeline.mesh import TriangleMesh
from pipeline.mesh.normals import NORMAL, unit
from pipeline.mesh.write import write_mesh
from render.base.atomic_write import disk_errors
from render.scene.materials import Material
from render.scene.textures import srgb_of_linear


def write_ply(path: Path, frame: ExportedFrame) -> None:
    """Write points and triangles with one number a property, as other programs read them.

    x y z nx ny nz  double; the normal of a vertex at a crease is the mean of its sides
    velocity_x …    float, scene units per second
    rest_x …        float, scene units
    red green blue  uchar, sRGB, where colours vary
    radius          float, of a point cloud

    Raises MachineError where the disk refuses.
    """
    attributes: dict[str, AnyArray] = {} if frame.radii is not None else {NORMAL: point_normals(frame)}
    attributes["velocity"] = frame.velocities.astype(np.float32)
    attributes["rest"] = frame.rest.astype(np.float32)
    if frame.colours is not None:
        attributes |= dict(
            zip(("red", "green", "blue"), _bytes(srgb_of_linear(frame.colours)).T, strict=True)
        )
    if frame.radii is not None:
        attributes["radius"] = frame.radii.astype(np.float32)
    write_mesh(TriangleMesh(frame.points, frame.faces, attributes), path)


def write_obj(path: Path, frame: ExportedFrame) -> None:
    """Write text with a normal for each corner, texture coordinates where there are any, and colours.

    Colours stand after the coordinates of a vertex, in sRGB. Numbers have nine digits, which hold float32.
    Raises MachineError where the disk refuses.
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
    with disk_errors(path):
        path.write_text("".join(lines), encoding="ascii")


def write_glb(path: Path, frame: ExportedFrame, look: Material) -> None:
    """Write a surface with normals, colours, material, and the attributes _VELOCITY and _REST.

    Vertices at creases are split, for glTF has one normal a vertex. Raises MachineError where the disk
    refuses.
    """
    import trimesh

    source = normal_vertices(frame)
    surface = preview_surface(look)
    opacity = () if surface.opacity == 1.0 else {"alphaMode": "BLEND"}
    is_varied = frame.colours is not None
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*((1.0, 1.0, 1.0) if is_varied else surface.colour), surface.opacity],
        metallicFactor=surface.metallic,
        roughnessFactor=surface.roughness,
        **dict(opacity),
    )
    visual = trimesh.visual.TextureVisuals(material=material)
    if frame.colours is not None:
        opaque = np.full((len(source), 1), 255, np.uint8)
        visual.vertex_attributes["color"] = np.hstack([_bytes(frame.colours[source]), opaque])
    model = trimesh.Trimesh(
        frame.points[source],
        frame.corner_normals,
        vertex_normals=frame.normals,
        visual=visual,
        vertex_attributes={
            "_VELOCITY": frame.velocities[source].astype(np.float32),
            "_REST": frame.rest[source].astype(np.float32),
        },
        process=False,
    )
    content = bytes(model.export(file_type="glb", include_normals=True))
    with disk_errors(path):
        path.write_bytes(content)


def normal_vertices(frame: ExportedFrame) -> Indices:
    """Return the vertex (N,) that each normal of a frame belongs to."""
    source = np.zeros(len(frame.normals), np.int32)
    source[frame.corner_normals.reshape(-1)] = frame.faces.reshape(-1)
    return source


def point_normals(frame: ExportedFrame) -> Vectors:
    """Return unit normals (V, 3) of the vertices: the mean of the sides of a crease."""
    sums = np.zeros_like(frame.points)
    np.add.at(sums, normal_vertices(frame), frame.normals)
    return unit(sums)


def _bytes(values: Floats) -> AnyArray:
    """Return numbers from 0 to 1 as uint8."""
    return np.asarray(np.rint(255.0 * np.clip(values, 0.0, 1.0)), np.uint8)


def _lines(form: str, rows: AnyArray) -> str:
    """Return a line of text for each row of numbers, float32 or whole."""
    held = rows.astype(np.float32) if rows.dtype.kind == "f" else rows
    values: Iterable[Any] = map(tuple, held.tolist())
    return "".join(f"{form % row}\n" for row in values)
