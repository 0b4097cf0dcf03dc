"""Moving meshes of USD stages: time samples, value clips and skeletons, at the times of the stage.

USD itself composes layers, so that the times of sublayers and references of another rate are scaled by it.
Stages whose meshes have samples of points are read at their samples, others at any time, as USD interpolates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.meshes import FileSurface, Floats
from flowsculpt.pipeline.plugins.interchange.moving_files import MotionFacts, require_times
from flowsculpt.pipeline.plugins.interchange.scene_readers import Polygons, joined
from flowsculpt.pipeline.plugins.interchange.usd_reader import (
    StageMeshes,
    open_stage,
    polygons_of,
    start_of,
    with_vectors,
)

_MOST_TIMES = 1_000_000

_JUMP = 1e-3
"""Time codes between the two samples of a jump, as between value clips: the later one counts."""

_FACES = {"faceVertexCounts", "faceVertexIndices", "holeIndices", "orientation", "visibility", "invisibleIds"}
_FACES |= {"protoIndices"}
"""Attributes whose samples change the faces."""

_MOVING = {"positions", "orientations", "scales", "translations", "rotations", "blendShapeWeights"} | _FACES
"""Attributes whose samples move vertices, in addition to `points` and transforms."""


class StageSource:
    """An open stage: see `MotionSource`. Raises MeshError where it has no prim of the path."""

    def __init__(self, path: str, prim: str | None) -> None:
        self._stage, _ = open_stage(path)
        self._start = start_of(self._stage, prim)
        self._skeletons = UsdSkel.Cache()
        codes: set[float] = set()
        self._is_fixed, self._is_continuous = True, True
        for attribute in self._attributes():
            name, times = attribute.GetName(), attribute.GetTimeSamples()
            if name in _MOVING or name == "points" or name.startswith("xformOp:"):
                codes.update(times)
                self._is_fixed = self._is_fixed and (name not in _FACES or len(times) < 2)
                self._is_continuous = self._is_continuous and (name != "points" or len(times) < 2)
            if len(codes) > _MOST_TIMES:
                raise MeshError(f"it has over {_MOST_TIMES} times. Export fewer frames")
        every = np.array(sorted(codes))
        self._codes = every[np.append(np.diff(every) > _JUMP, True)[: len(every)]]
        self._is_continuous = self._is_continuous and self._is_fixed

    def _attributes(self) -> Iterator[Usd.Attribute]:
        """Yield the attributes of what is shown, of all above it, and of skeletons and their animations."""
        prim = self._start.GetParent()
        while prim:
            yield from prim.GetAttributes()
            prim = prim.GetParent()
        for prim in Usd.PrimRange(self._start, Usd.TraverseInstanceProxies()):
            yield from prim.GetAttributes()
        for prim in self._stage.Traverse():
            if prim.IsA(UsdSkel.Root):
                self._skeletons.Populate(UsdSkel.Root(prim), Usd.PrimDefaultPredicate)
            if prim.IsA(UsdSkel.Animation) or prim.IsA(UsdSkel.Skeleton):
                yield from prim.GetAttributes()

    @property
    def motion(self) -> MotionFacts:
        times = (
            self._codes if not self._is_continuous else np.unique(self._codes[[0, -1]][: len(self._codes)])
        )
        require_times(times, "Export it with its animation, or write model in place of sequence.")
        rate = self._stage.GetFramesPerSecond()
        times = times / self._stage.GetTimeCodesPerSecond()
        return MotionFacts(times, rate, self._is_fixed, self._is_continuous)

    def surface(self, seconds: float) -> FileSurface:
        code = seconds * self._stage.GetTimeCodesPerSecond()
        if not self._is_continuous:
            last = int(np.searchsorted(self._codes, code + 1e-6, "right")) - 1
            code = float(self._codes[max(last, 0)])
        meshes = _MovingMeshes(Usd.TimeCode(code), skeletons=self._skeletons)
        meshes.add(self._start)
        if not meshes.placed.parts:
            raise MeshError("it holds no mesh that is active, visible and of purpose default or render then")
        return joined(meshes.placed.parts)


@dataclass
class _MovingMeshes(StageMeshes):
    """Collects meshes with their velocities, where their skeletons take them."""

    skeletons: UsdSkel.Cache = field(default_factory=UsdSkel.Cache)

    def _add_prim(self, prim: Usd.Prim, to_stage: Floats, depth: int) -> None:
        query = self.skeletons.GetSkinningQuery(prim) if prim.IsA(UsdGeom.Mesh) else None
        if not query:
            super()._add_prim(prim, to_stage, depth)
            return
        if depth:
            raise MeshError(f"{shorten(prim.GetPath())} has a skeleton within a point instancer. Flatten it")
        polygons, skeleton = self._polygons(prim), UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
        posed = self.skeletons.GetSkelQuery(skeleton)
        if not posed:
            self.placed.add(polygons, to_stage)
            return
        points, is_carried = _skinned(prim, query, posed, self.time, polygons.points)
        if is_carried:
            cache = UsdGeom.XformCache(self.time)
            to_stage = np.array(cache.GetLocalToWorldTransform(skeleton.GetPrim()))
        self.placed.add(polygons._replace(points=points, velocities=None, normals=None), to_stage)

    def _polygons(self, prim: Usd.Prim) -> Polygons:
        mesh, path = UsdGeom.Mesh(prim), shorten(prim.GetPath())
        polygons = polygons_of(mesh, self.time, path)
        polygons = with_vectors(polygons, mesh, self.time, path)
        return polygons._replace(velocities=None) if _is_carried(prim) else polygons


def _is_carried(prim: Usd.Prim) -> bool:
    """Return whether a prim's transforms move it, in addition to its velocities."""
    while prim:
        shape = UsdGeom.Xformable(prim)
        if shape and shape.TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False


def _skinned(
    prim: Usd.Prim,
    query: UsdSkel.SkinningQuery,
    posed: UsdSkel.SkeletonQuery,
    time: Usd.TimeCode,
    points: Floats,
) -> tuple[Floats, bool]:
    """Return the points (V, 3) of a mesh after blend shapes and its skeleton.

    Also returns whether the skeleton carries them: they are in its coordinates then.
    """
    animation = posed.GetAnimQuery()
    moved = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
    if animation and query.HasBlendShapes():
        weights = animation.ComputeBlendShapeWeights(time)
        mapper = query.GetBlendShapeMapper()
        weights = mapper.Remap(weights) if mapper and not mapper.IsNull() else weights
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        found = shapes.ComputeSubShapeWeights(weights)
        indices, offsets = shapes.ComputeBlendShapePointIndices(), shapes.ComputeSubShapePointOffsets()
        if not shapes.ComputeDeformedPoints(*found, indices, offsets, moved):
            raise MeshError(f"{shorten(prim.GetPath())}: its blend shapes do not fit")
    if not query.HasJointInfluences():
        return np.array(moved, np.float64), False
    joints = posed.ComputeSkinningTransforms(time)
    if query.IsRigidlyDeformed():
        matrix = np.array(query.ComputeSkinnedTransform(joints, time))
        values = np.array(moved, np.float64)
        return values @ matrix[:3, :3] + matrix[3, :3], True
    if not query.ComputeSkinnedPoints(joints, moved, time):
        raise MeshError(f"{shorten(prim.GetPath())}: its joints and weights do not fit its points")
    return np.array(moved, np.float64), True
