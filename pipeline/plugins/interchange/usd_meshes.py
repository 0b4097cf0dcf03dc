"""Meshes of a USD stage at one time, in its coordinates: with transforms, instances and creases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import MeshError, brief
from pipeline.plugins.interchange.scene_readers import PlacedMeshes, Polygons, reversed_faces
from render.base.plural import plural

if TYPE_CHECKING:  # USD is an optional package, and takes a moment to import
    from pxr import Usd, UsdGeom

MOST_PRIMS = 50_000
"""Prims that are visited; those of instances count each time."""

_DEEPEST = 8
"""Point instancers within prototypes of point instancers."""


@dataclass
class StageMeshes:
    """Collects the meshes below prims: active, visible, of purpose default or render, instances included.

    time     of the stage
    placed   the meshes
    cages    number of meshes that ask to be subdivided
    omitted  number of prims of each other kind that has a shape
    """

    time: Usd.TimeCode
    placed: PlacedMeshes = field(default_factory=lambda: PlacedMeshes("select fewer with prim"))
    cages: int = 0
    omitted: Counter[str] = field(default_factory=Counter)
    _read: dict[str, Polygons] = field(default_factory=dict)
    _prims: int = 0

    def add(self, start: Usd.Prim) -> None:
        """Add the meshes below a prim, placed as they are on the stage.

        Raises MeshError for a mesh whose numbers contradict each other, and for more than the limits.
        """
        from pxr import UsdGeom

        cache = UsdGeom.XformCache(self.time)
        shape = UsdGeom.Imageable(start)
        if shape and shape.ComputeVisibility(self.time) == UsdGeom.Tokens.invisible:
            return  # one above it hides it
        for prim in self._visible(start):
            self._add_prim(prim, np.array(cache.GetLocalToWorldTransform(prim)), 0)

    def _visible(self, start: Usd.Prim) -> Iterator[Usd.Prim]:
        """Yield the shapes below a prim that are seen, those of instances too; not prototypes of others."""
        from pxr import Usd, UsdGeom

        shown = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
        waiting = [
            (start, UsdGeom.Imageable(start).ComputePurposeInfo() if start.IsA(UsdGeom.Imageable) else None)
        ]
        while waiting:
            prim, purpose = waiting.pop()
            self._count(1)
            shape = UsdGeom.Imageable(prim)
            if shape and shape.GetVisibilityAttr().Get(self.time) == UsdGeom.Tokens.invisible:
                continue
            is_instancer = prim.IsA(UsdGeom.PointInstancer)
            if (is_instancer or prim.IsA(UsdGeom.Gprim)) and (purpose is None or purpose.purpose in shown):
                yield prim
            if is_instancer:
                continue  # its prototypes are seen at its points only
            for child in reversed(prim.GetFilteredChildren(Usd.TraverseInstanceProxies())):
                below = UsdGeom.Imageable(child)
                told = purpose or UsdGeom.Imageable.PurposeInfo()
                waiting.append((child, below.ComputePurposeInfo(told) if below else purpose))

    def _count(self, prims: int) -> None:
        """Count prims that are visited. Raises MeshError for too many."""
        self._prims += prims
        if self._prims > MOST_PRIMS:
            raise MeshError(f"it has over {MOST_PRIMS} prims with its instances; select fewer with prim")

    def _add_prim(self, prim: Usd.Prim, to_stage: Floats, depth: int) -> None:
        """Add a prim, which lies on the stage by a matrix (4, 4)."""
        from pxr import UsdGeom

        if prim.IsA(UsdGeom.Mesh):
            self.placed.add(self._polygons(prim), to_stage)
        elif prim.IsA(UsdGeom.PointInstancer):
            self._add_instances(UsdGeom.PointInstancer(prim), to_stage, depth)
        elif prim.IsA(UsdGeom.Gprim):
            self.omitted[str(prim.GetTypeName())] += 1

    def _polygons(self, prim: Usd.Prim) -> Polygons:
        """Return the faces of a mesh in its own coordinates; those of instances are read once."""
        from pxr import UsdGeom

        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        path = str(source.GetPath())
        if path not in self._read:
            mesh = UsdGeom.Mesh(source)
            self._read[path] = _polygons(mesh, self.time, brief(prim.GetPath()))
            scheme = mesh.GetSubdivisionSchemeAttr()
            self.cages += scheme.HasAuthoredValue() and scheme.Get() != UsdGeom.Tokens.none
        return self._read[path]

    def _add_instances(self, instancer: UsdGeom.PointInstancer, to_stage: Floats, depth: int) -> None:
        """Add the prototypes of a point instancer at each of its points that is not masked."""
        from pxr import UsdGeom

        path = str(instancer.GetPath())
        if depth >= _DEEPEST:
            raise MeshError(f"{brief(path)} is a point instancer within {_DEEPEST} others; flatten the stage")
        stage = instancer.GetPrim().GetStage()
        prototypes = [stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetForwardedTargets()]
        which = np.array(instancer.GetProtoIndicesAttr().Get(self.time) or (), np.int64)
        placements = np.array(
            instancer.ComputeInstanceTransformsAtTime(
                self.time,
                self.time,
                UsdGeom.PointInstancer.IncludeProtoXform,
                UsdGeom.PointInstancer.IgnoreMask,
            )
        ).reshape(-1, 4, 4)
        if len(placements) != len(which) or ((which < 0) | (which >= len(prototypes))).any():
            raise MeshError(f"{brief(path)}: its positions, orientations, scales and protoIndices do not fit")
        shown = np.array(instancer.ComputeMaskAtTime(self.time) or np.ones(len(which)), bool)
        for number in np.unique(which[shown]).tolist():
            if not prototypes[number]:
                raise MeshError(f"{brief(path)}: its prototype {number} is not on the stage")
            self._count(int((shown & (which == number)).sum()))
            here = placements[shown & (which == number)]
            self._add_prototype(prototypes[number], [matrix @ to_stage for matrix in here], depth)

    def _add_prototype(self, root: Usd.Prim, to_stage: list[Floats], depth: int) -> None:
        """Add what is below a prototype at each of some places."""
        from pxr import UsdGeom

        cache = UsdGeom.XformCache(self.time)
        for prim in self._visible(root):
            within = np.array(cache.ComputeRelativeTransform(prim, root)[0])
            for matrix in to_stage:
                self._add_prim(prim, within @ matrix, depth + 1)

    @property
    def omitted_words(self) -> str:
        """Number and type of prims that were left out: `2 Cube, 1 BasisCurves`."""
        return ", ".join(f"{count} {brief(name)}" for name, count in sorted(self.omitted.items())[:5])

    def notes(self) -> list[str]:
        """Return lines about what was not read as other programs show it."""
        lines = []
        if self.cages:
            meshes, asks = plural(self.cages, "mesh", "meshes"), "asks" if self.cages == 1 else "ask"
            lines.append(
                f"{meshes} {asks} to be subdivided by subdivisionScheme, which is not done here; "
                "to make it smooth, subdivide it in the program that made the stage"
            )
        if self.omitted:
            lines.append(f"left out, as they are not meshes: {self.omitted_words}")
        return lines


def _polygons(mesh: UsdGeom.Mesh, time: Usd.TimeCode, path: str) -> Polygons:
    """Return the faces of a mesh in its own coordinates, without holes.

    path  of the mesh, for messages

    Raises MeshError.
    """
    from pxr import UsdGeom

    points = _numbers(mesh.GetPointsAttr(), time, path, "f", 3).astype(np.float64)
    sides = _numbers(mesh.GetFaceVertexCountsAttr(), time, path, "iu").astype(np.int64)
    corners = _numbers(mesh.GetFaceVertexIndicesAttr(), time, path, "iu").astype(np.int64)
    if (sides < 0).any() or sides.sum() != len(corners):
        raise MeshError(
            f"{path}: its faceVertexCounts ask for {sides.sum()} corners, and faceVertexIndices has "
            f"{len(corners)}"
        )
    wrong = np.flatnonzero((corners < 0) | (corners >= len(points)))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(sides), wrong[0], side="right"))
        raise MeshError(
            f"{path}: face {face} names vertex {corners[wrong[0]]}; the mesh has {len(points)} points, "
            "numbered from 0"
        )
    holes = _numbers(mesh.GetHoleIndicesAttr(), time, path, "iu").astype(np.int64)
    kept = np.ones(len(sides), bool)
    kept[holes[(holes >= 0) & (holes < len(sides))]] = False
    corners, sides = corners[np.repeat(kept, sides)], sides[kept]
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        corners = reversed_faces(corners, sides)
    return Polygons(points, sides, corners, _creases(mesh, time, path, len(points)))


def _creases(mesh: UsdGeom.Mesh, time: Usd.TimeCode, path: str, points: int) -> AnyArray:
    """Return the edges (K, 2) of a mesh that have a sharpness. Raises MeshError."""
    chain = _numbers(mesh.GetCreaseIndicesAttr(), time, path, "iu").astype(np.int64)
    lengths = _numbers(mesh.GetCreaseLengthsAttr(), time, path, "iu").astype(np.int64)
    sharpness = _numbers(mesh.GetCreaseSharpnessesAttr(), time, path, "f")
    edges = lengths.sum() - len(lengths)
    fits = (lengths >= 2).all() and lengths.sum() == len(chain) and len(sharpness) in (len(lengths), edges)
    if not fits or ((chain < 0) | (chain >= points)).any():
        raise MeshError(f"{path}: its creaseIndices, creaseLengths and creaseSharpnesses do not fit")
    if not len(chain):
        return np.empty((0, 2), np.int64)
    within = np.ones(len(chain), bool)
    within[np.cumsum(lengths) - 1] = False  # the last vertex of a crease begins no edge
    starts = np.flatnonzero(within)
    each = sharpness if len(sharpness) == edges else np.repeat(sharpness, lengths - 1)
    return np.column_stack([chain[starts], chain[starts + 1]])[each > 0.0]


def _numbers(attribute: Any, time: Usd.TimeCode, path: str, kinds: str, columns: int = 1) -> AnyArray:
    """Return the values (N,) or (N, columns) of an attribute; none where it has no value.

    kinds  letters of numpy for the kind of number it must have

    Raises MeshError for values of another type.
    """
    value, row = attribute.Get(time), (columns,) if columns > 1 else ()
    values = np.empty((0, *row), kinds[0]) if value is None else np.asarray(value)
    if values.ndim and not len(values):
        return np.empty((0, *row), kinds[0])
    if values.dtype.kind not in kinds or values.ndim != 1 + len(row) or values.shape[1:] != row:
        raise MeshError(f"{path}: {attribute.GetName()} is not of type {attribute.GetTypeName()}")
    return values
