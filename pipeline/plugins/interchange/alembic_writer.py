"""Write an Alembic file of meshes: `python -m flowsculpt.pipeline.plugins.interchange.alembic_writer FILE`.

A process of its own, since the library ends its process where the disk is full. The package alembic3d, an
unofficial build of Alembic's own bindings, must be installed.

Standard input has a line of JSON, `title`, `rate` and `meshes`; of each mesh `name`, `frames`, the `step`
from one to the next, the numbers of `faces`, `points` and `normals`, and whether it is `textured`. Then
follow of each mesh int32 faces (F, 3) and rows of the normals of their corners (F, 3), float32 texture
coordinates (F, 3, 2) if it is textured, and of each frame float32 points (V, 3) and normals (N, 3).
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any, BinaryIO

import imath
import numpy as np
from alembic3d import Abc, AbcCoreAbstract, AbcGeom

_AT_CORNERS = AbcGeom.GeometryScope.kFacevaryingScope


def write(path: str, source: BinaryIO) -> None:
    """Write the meshes that a stream describes."""
    facts = json.loads(source.readline())
    archive = Abc.CreateArchiveWithInfo(path, facts["rate"], "flowsculpt", facts["title"])
    for mesh in facts["meshes"]:
        _write_mesh(archive.getTop(), facts["rate"], mesh, source)


def _write_mesh(parent: Any, rate: float, facts: dict[str, Any], source: BinaryIO) -> None:
    schema = AbcGeom.OPolyMesh(parent, facts["name"]).getSchema()
    frames = facts["frames"]
    schema.setTimeSampling(AbcCoreAbstract.TimeSampling(facts["step"] / rate, frames[0] / rate))
    count = facts["faces"]
    faces, of_normals = (_read(source, np.int32, count, 3) for _ in range(2))
    corners = imath.IntArrayFromBuffer(_at_corners(faces))
    sides = imath.IntArrayFromBuffer(np.full(count, 3, np.int32))
    rows = imath.UnsignedIntArray(imath.DoubleArrayFromBuffer(_at_corners(of_normals).astype(np.float64)))
    placed = AbcGeom.OV2fGeomParamSample()
    if facts["textured"]:
        coordinates = imath.V2fArrayFromBuffer(_at_corners(_read(source, np.float32, count, 3, 2)))
        placed = AbcGeom.OV2fGeomParamSample(coordinates, _AT_CORNERS)
    for _ in frames:
        points = imath.V3fArrayFromBuffer(_read(source, np.float32, facts["points"], 3))
        values = imath.V3fArrayFromBuffer(_read(source, np.float32, facts["normals"], 3))
        normals = AbcGeom.ON3fGeomParamSample(values, rows, _AT_CORNERS)
        schema.set(AbcGeom.OPolyMeshSchemaSample(points, corners, sides, placed, normals))


def _read(source: BinaryIO, kind: type, *shape: int) -> Any:
    """Return the next array of the stream."""
    content = source.read(math.prod(shape) * np.dtype(kind).itemsize)
    return np.frombuffer(content, kind).reshape(shape).copy()


def _at_corners(values: Any) -> Any:
    """Return values (F, 3, …) at corners as (3F, …), clockwise seen from outside, as Alembic's faces are."""
    return np.ascontiguousarray(values[:, ::-1].reshape(-1, *values.shape[2:]))


if __name__ == "__main__":
    write(sys.argv[1], sys.stdin.buffer)
