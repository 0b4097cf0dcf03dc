"""Meshes of Alembic archives in the process that reads them, at the times of their samples.

Transforms and points between two samples are taken linearly, where an archive has several rates.
Alembic's faces are clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from alembic3d import Abc, AbcGeom

from flowsculpt import MeshError
from flowsculpt.api import plural, shorten
from flowsculpt.api.meshes import FileSurface, Floats
from flowsculpt.pipeline.plugins.interchange.moving_files import MotionFacts, require_times
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    VELOCITIES,
    PlacedMeshes,
    Polygons,
    cages_note,
    joined,
    require_vertices,
    reversed_faces,
    vertex_normals,
)

_MOST_OBJECTS, _MOST_TIMES = 50_000, 1_000_000

_CLOSE = 1e-6
"""Seconds within which a time is that of a sample."""

_CHANGING = AbcGeom.MeshTopologyVariance.kHeterogenousTopology


@dataclass
class _Placed:
    """An object, its path, and what is above it: schemas of transforms, innermost first, and all objects."""

    object: Any
    path: str
    transforms: list[Any]
    above: list[Any]


class AlembicSource:
    """An open archive: see `MotionSource`. Raises MeshError where it holds no mesh."""

    def __init__(self, path: str) -> None:
        self._archive = Abc.IArchive(path)
        self._left_out: dict[str, int] = {}
        self._meshes = list(self._found())
        if not self._meshes:
            raise MeshError("it holds no mesh. Export meshes")

    def _found(self) -> Iterator[_Placed]:
        """Yield the meshes of the archive."""
        waiting = [_Placed(self._archive.getTop(), "", [], [])]
        count = 0
        while waiting:
            at, below = waiting.pop(), []
            for k in range(at.object.getNumChildren()):
                header = at.object.getChildHeader(k)
                name, facts = header.getName(), header.getMetaData()
                count += 1
                if count > _MOST_OBJECTS:
                    raise MeshError(f"it has over {_MOST_OBJECTS} objects. Export fewer")
                path, above = f"{at.path}/{name}", [*at.above, at.object]
                if AbcGeom.IPolyMesh.matches(facts):
                    yield _Placed(AbcGeom.IPolyMesh(at.object, name), path, at.transforms, above)
                elif AbcGeom.ISubD.matches(facts):
                    yield _Placed(AbcGeom.ISubD(at.object, name), path, at.transforms, above)
                elif AbcGeom.IXform.matches(facts):
                    placed = AbcGeom.IXform(at.object, name)
                    below.append(_Placed(placed, path, [placed.getSchema(), *at.transforms], above))
                else:
                    below.append(_Placed(at.object.getChild(k), path, at.transforms, above))
            waiting += reversed(below)

    @property
    def motion(self) -> MotionFacts:
        schemas = [mesh.object.getSchema() for mesh in self._meshes]
        moving = [schema for schema in schemas if not schema.isConstant()]
        moving += [schema for mesh in self._meshes for schema in mesh.transforms if not schema.isConstant()]
        flags = [
            AbcGeom.GetVisibilityProperty(each)
            for mesh in self._meshes
            for each in [*mesh.above[1:], mesh.object]
        ]
        hidden = [flag for flag in flags if flag.valid() and not flag.isConstant()]
        every = [np.empty(0), *map(_times_of, [*moving, *hidden])]
        times = np.unique(np.concatenate(every))
        times = times[np.append(True, np.diff(times) > _CLOSE)[: len(times)]]
        require_times(times, "Export it with its animation, or write model in place of sequence.")
        samplings = [schema.getTimeSampling().getTimeSamplingType() for schema in moving]
        steps = {kind.getTimePerCycle() for kind in samplings if kind.isUniform()}
        rate = 1.0 / min(steps) if steps and min(steps) > 0.0 else None
        is_fixed = not hidden and all(schema.getTopologyVariance() != _CHANGING for schema in schemas)
        return MotionFacts(times, rate, is_fixed, False)

    def surface(self, seconds: float) -> FileSurface:
        meshes = PlacedMeshes("export fewer")
        hidden, cages = 0, 0
        for mesh in self._meshes:
            if not _is_shown(mesh, seconds):
                hidden += 1
                continue
            cages += isinstance(mesh.object, AbcGeom.ISubD)
            matrix = np.eye(4)
            for transform in mesh.transforms:
                matrix = matrix @ _matrix_at(transform, seconds)
                if not transform.getInheritsXforms(Abc.ISampleSelector(seconds)):
                    break
            polygons = _polygons(mesh.object.getSchema(), mesh.path, seconds)
            if any(not transform.isConstant() for transform in mesh.transforms):
                polygons = polygons._replace(velocities=None)  # they lack those of the transforms
            meshes.add(polygons, matrix)
        if not meshes.parts:
            raise MeshError("all its meshes are hidden then")
        notes = []
        if hidden:
            notes.append(f"{plural(hidden, 'hidden mesh', 'hidden meshes')} left out")
        if cages:
            notes.append(cages_note(cages))
        return joined(meshes.parts, notes)


def _times_of(values: Any) -> Floats:
    """Return the times (N,) of the samples of a schema or property."""
    count, sampling = values.getNumSamples(), values.getTimeSampling()
    if count > _MOST_TIMES:
        raise MeshError(f"it has over {_MOST_TIMES} times. Export fewer frames")
    return np.array([sampling.getSampleTime(k) for k in range(count)])


def _around(values: Any, seconds: float) -> tuple[int, int, float]:
    """Return the samples around a time, and how far it is from the first to the second, from 0 to 1."""
    times = _times_of(values)
    last = len(times) - 1
    before = int(np.clip(np.searchsorted(times, seconds + _CLOSE, "right") - 1, 0, max(last, 0)))
    after = min(before + 1, last)
    if after <= before or seconds <= times[before] + _CLOSE:
        return before, before, 0.0
    return before, after, float((seconds - times[before]) / (times[after] - times[before]))


def _sample(values: Any, number: int) -> Any:
    """Return a sample of a schema or property: of a number the library makes a time, so it gets the time."""
    return values.getValue(Abc.ISampleSelector(_time_of(values, number)))


def _time_of(values: Any, number: int) -> float:
    return float(values.getTimeSampling().getSampleTime(number))


def _matrix_at(schema: Any, seconds: float) -> Floats:
    """Return the matrix (4, 4) of row vectors of a transform."""
    before, after, share = _around(schema, seconds)

    def matrix(sample: int) -> Floats:
        values = _sample(schema, sample).getMatrix()
        return np.array([[values[row][column] for column in range(4)] for row in range(4)])

    return matrix(before) if share == 0.0 else (1.0 - share) * matrix(before) + share * matrix(after)


def _is_shown(mesh: _Placed, seconds: float) -> bool:
    """Return whether neither a mesh nor an object above it is hidden."""
    for each in [*mesh.above[1:], mesh.object]:
        flag = AbcGeom.GetVisibilityProperty(each)
        if flag.valid() and flag.getNumSamples():
            before, _, _ = _around(flag, seconds)
            if int(_sample(flag, before)) == 0:
                return False
    return True


def _polygons(schema: Any, path: str, seconds: float) -> Polygons:
    """Return the faces of a mesh in its own coordinates. Raises MeshError, with its path."""
    before, after, share = _around(schema, seconds)
    sample = _sample(schema, before)
    points = _rows(sample.getPositions())
    share = share if schema.getTopologyVariance() != _CHANGING else 0.0
    if share:
        other = _rows(_sample(schema, after).getPositions())
        if other.shape != points.shape:
            raise MeshError(f"{shorten(path)} has {len(points)} points, and {len(other)} in its next sample")
        points = (1.0 - share) * points + share * other
    sides = np.array(sample.getFaceCounts(), np.int64)
    corners = np.array(sample.getFaceIndices(), np.int64)
    if (sides < 0).any() or sides.sum() != len(corners):
        raise MeshError(
            f"{shorten(path)}: its faces ask for {sides.sum()} corners, and it has {len(corners)}"
        )
    require_vertices(corners, sides, len(points), shorten(path))
    velocities = _velocities(schema, sample, before)
    if velocities is not None and velocities.shape != points.shape:
        raise MeshError(f"{shorten(path)} has {len(points)} points and {len(velocities)} velocities")
    normals = None
    if isinstance(schema, AbcGeom.IPolyMeshSchema) and schema.getNormalsParam().valid():
        values = _expanded(schema.getNormalsParam(), _time_of(schema, before))
        if share:
            later = _expanded(schema.getNormalsParam(), _time_of(schema, after))
            values = (1.0 - share) * values + share * later if later.shape == values.shape else values
        normals = vertex_normals(values, corners, len(points))
    return Polygons(points, sides, reversed_faces(corners, sides), velocities=velocities, normals=normals)


def _velocities(schema: Any, sample: Any, number: int) -> Floats | None:
    """Return the velocities (V, 3) of a sample: Alembic's own, or an attribute of points."""
    own = sample.getVelocities()
    if own is not None and len(own):
        return _rows(own)
    others = schema.getArbGeomParams()
    for name in VELOCITIES if others.valid() else ():
        header = others.getPropertyHeader(name)
        if header is not None and AbcGeom.IV3fGeomParam.matches(header):
            return _expanded(AbcGeom.IV3fGeomParam(others, name), _time_of(schema, number))
    return None


def _expanded(values: Any, seconds: float) -> Floats:
    """Return the vectors (N, 3) of an attribute at a time, one for each of its elements."""
    return _rows(values.getExpandedValue(Abc.ISampleSelector(seconds)).getVals())


def _rows(values: Any) -> Floats:
    return np.array(values, np.float64).reshape(-1, 3)
