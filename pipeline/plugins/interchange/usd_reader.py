"""Stages of USD in the process that reads them: their layers, and their meshes at one time.

Meshes are read in the coordinates of the stage, with transforms, instances and creases.
"""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdGeom

from flowsculpt import FlowsculptError, MeshError, MissingInputError
from flowsculpt.api import plural, shorten, suggest
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    VELOCITIES,
    PlacedMeshes,
    Polygons,
    joined,
    packed_surface,
    require_vertices,
    reversed_faces,
    vertex_normals,
)

MOST_BYTES = 8 << 30  # size of the largest layer, of which only the samples at one time are read
_MOST_MEMORY = 40 << 30  # bytes that a stage of large layers may take
_MOST_LAYERS = 10_000
MOST_PRIMS = 50_000  # prims that are visited; those of instances count each time
_DEEPEST = 8  # point instancers within prototypes of point instancers


@dataclass
class StageMeshes:
    """Collects the meshes below prims: active, visible, of purpose default or render, instances included.

    time     of the stage
    placed   the meshes
    cages    number of meshes that ask to be subdivided
    """

    time: Usd.TimeCode
    placed: PlacedMeshes = field(default_factory=lambda: PlacedMeshes("select fewer with prim"))
    cages: int = 0
    _read: dict[str, Polygons] = field(default_factory=dict)
    _prims: int = 0

    def add(self, start: Usd.Prim) -> None:
        """Add the meshes below a prim, placed as they are on the stage.

        Raises MeshError for a mesh whose numbers contradict each other, and for more than the limits.
        """
        cache = UsdGeom.XformCache(self.time)
        shape = UsdGeom.Imageable(start)
        if shape and shape.ComputeVisibility(self.time) == UsdGeom.Tokens.invisible:
            return  # one above it hides it
        for prim in self._visible(start):
            self._add_prim(prim, np.array(cache.GetLocalToWorldTransform(prim)), 0)

    def _visible(self, start: Usd.Prim) -> Iterator[Usd.Prim]:
        """Yield the shapes below a prim that are seen, those of instances too; not prototypes of others."""
        shown = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
        shape = UsdGeom.Imageable(start)
        waiting = [(start, shape.ComputePurposeInfo() if start.IsA(UsdGeom.Imageable) else None)]
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
        if prim.IsA(UsdGeom.Mesh):
            self.placed.add(self._polygons(prim), to_stage)
        elif prim.IsA(UsdGeom.PointInstancer):
            self._add_instances(UsdGeom.PointInstancer(prim), to_stage, depth)
        elif prim.IsA(UsdGeom.Gprim):
            self.placed.left_out[str(prim.GetTypeName())] += 1

    def _polygons(self, prim: Usd.Prim) -> Polygons:
        """Return the faces of a mesh in its own coordinates; those of instances are read once."""
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        path = str(source.GetPath())
        if path not in self._read:
            mesh = UsdGeom.Mesh(source)
            polygons = polygons_of(mesh, self.time, shorten(prim.GetPath()))
            self._read[path] = with_vectors(polygons, mesh, self.time, shorten(prim.GetPath()))
            scheme = mesh.GetSubdivisionSchemeAttr()
            self.cages += scheme.HasAuthoredValue() and scheme.Get() != UsdGeom.Tokens.none
        return self._read[path]

    def _add_instances(self, instancer: UsdGeom.PointInstancer, to_stage: Floats, depth: int) -> None:
        """Add the prototypes of a point instancer at each of its points that is not masked."""
        path = str(instancer.GetPath())
        if depth >= _DEEPEST:
            raise MeshError(
                f"{shorten(path)} is a point instancer within {_DEEPEST} others; flatten the stage"
            )
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
            raise MeshError(
                f"{shorten(path)}: its positions, orientations, scales and protoIndices do not fit"
            )
        shown = np.array(instancer.ComputeMaskAtTime(self.time) or np.ones(len(which)), bool)
        for number in np.unique(which[shown]).tolist():
            if not prototypes[number]:
                raise MeshError(f"{shorten(path)}: its prototype {number} is not on the stage")
            self._count(int((shown & (which == number)).sum()))
            here = placements[shown & (which == number)]
            self._add_prototype(prototypes[number], [matrix @ to_stage for matrix in here], depth)

    def _add_prototype(self, root: Usd.Prim, to_stage: list[Floats], depth: int) -> None:
        """Add what is below a prototype at each of some places."""
        cache = UsdGeom.XformCache(self.time)
        for prim in self._visible(root):
            within = np.array(cache.ComputeRelativeTransform(prim, root)[0])
            for matrix in to_stage:
                self._add_prim(prim, within @ matrix, depth + 1)

    def notes(self) -> list[str]:
        """Return lines about what was not read as other programs show it."""
        lines = []
        if self.cages:
            meshes, asks = plural(self.cages, "mesh", "meshes"), "asks" if self.cages == 1 else "ask"
            lines.append(
                f"{meshes} {asks} to be subdivided by subdivisionScheme, which is not done here; "
                "to make it smooth, subdivide it in the program that made the stage"
            )
        if words := self.placed.left_out_words:
            lines.append(f"left out, as they are not meshes: {words}")
        return lines


def polygons_of(mesh: UsdGeom.Mesh, time: Usd.TimeCode, path: str, are_numbered: bool = False) -> Polygons:
    """Return the faces of a mesh in its own coordinates, without holes. Raises MeshError, with its path.

    are_numbered  True for the number of each corner in the file, in place of its point
    """
    points = numbers_at(mesh.GetPointsAttr(), time, path, "f", 3).astype(np.float64)
    sides = numbers_at(mesh.GetFaceVertexCountsAttr(), time, path, "iu").astype(np.int64)
    corners = numbers_at(mesh.GetFaceVertexIndicesAttr(), time, path, "iu").astype(np.int64)
    if (sides < 0).any() or sides.sum() != len(corners):
        raise MeshError(
            f"{path}: its faceVertexCounts ask for {sides.sum()} corners, and faceVertexIndices has "
            f"{len(corners)}"
        )
    require_vertices(corners, sides, len(points), path)
    corners = np.arange(len(corners)) if are_numbered else corners
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        corners = reversed_faces(corners, sides)
    polygons = Polygons(points, sides, corners, _creases(mesh, time, path, len(points)))
    holes = numbers_at(mesh.GetHoleIndicesAttr(), time, path, "iu").astype(np.int64)
    return polygons.without(np.isin(np.arange(len(sides)), holes)) if len(holes) else polygons


def _creases(mesh: UsdGeom.Mesh, time: Usd.TimeCode, path: str, points: int) -> np.ndarray:
    """Return the edges (K, 2) of a mesh that have a sharpness. Raises MeshError."""
    chain = numbers_at(mesh.GetCreaseIndicesAttr(), time, path, "iu").astype(np.int64)
    lengths = numbers_at(mesh.GetCreaseLengthsAttr(), time, path, "iu").astype(np.int64)
    sharpness = numbers_at(mesh.GetCreaseSharpnessesAttr(), time, path, "f")
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


def with_vectors(polygons: Polygons, mesh: UsdGeom.Mesh, time: Usd.TimeCode, path: str) -> Polygons:
    """Return the faces of a mesh with its velocities, and with its normals if it is not to be subdivided.

    Raises MeshError, with its path.
    """
    count, named = len(polygons.points), UsdGeom.PrimvarsAPI(mesh)
    others = [named.GetPrimvar(name).GetAttr() for name in VELOCITIES]
    vectors = [it for it in others if it and it.GetTypeName().cppTypeName == "VtArray<GfVec3f>"]
    for attribute in (mesh.GetVelocitiesAttr(), *vectors):
        velocities = numbers_at(attribute, time, path, "f", 3).astype(np.float64)
        if len(velocities):
            if len(velocities) != count:
                raise MeshError(f"{path} has {count} points and {len(velocities)} velocities")
            polygons = polygons._replace(velocities=velocities)
            break
    if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
        return polygons
    primvar = named.GetPrimvar("normals")
    values = primvar.ComputeFlattened(time) if primvar else mesh.GetNormalsAttr().Get(time)
    if values is None:
        return polygons
    corners = numbers_at(mesh.GetFaceVertexIndicesAttr(), time, path, "iu").astype(np.int64)
    normals = np.array(values, np.float64).reshape(-1, 3)
    return polygons._replace(normals=vertex_normals(normals, corners, count))


def numbers_at(attribute: Any, time: Usd.TimeCode, path: str, kinds: str, columns: int = 1) -> np.ndarray:
    """Return the values (N,) or (N, columns) of an attribute; none where it has no value.

    Raises MeshError for values of another type; `kinds` are the letters of numpy for the right ones.
    """
    value, row = attribute.Get(time), (columns,) if columns > 1 else ()
    values = np.empty((0, *row), kinds[0]) if value is None else np.asarray(value)
    if values.ndim and not len(values):
        return np.empty((0, *row), kinds[0])
    if values.dtype.kind not in kinds or values.ndim != 1 + len(row) or values.shape[1:] != row:
        raise MeshError(f"{path}: {attribute.GetName()} is not of type {attribute.GetTypeName()}")
    return values


def open_stage(path: str) -> tuple[Usd.Stage, list[str]]:
    """Return a stage and the files of its layers. Raises MissingInputError or MeshError."""
    size = InputFile(Path(path), MOST_BYTES).size()
    Parser.allow_memory(Parser.MEMORY // 4 + min(40 * size, _MOST_MEMORY))
    layers = StageLayers(path)
    layers.open_all()
    Parser.allow_memory(Parser.MEMORY + min(40 * layers.size, _MOST_MEMORY))
    return _opened(path), list(layers.files)


def facts_of(stage: Usd.Stage, files: list[str]) -> bytes:
    """Return the axis that is up on a stage, and its files, as JSON."""
    up = "z" if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else "y"
    return json.dumps({"up": up, "files": files}).encode()


def surface_of(stage: Usd.Stage, prim: str | None, time_code: float | None) -> bytes:
    """Return the meshes of a stage, or of those below a prim, as one surface, packed. Raises MeshError."""
    start, meshes = start_of(stage, prim), StageMeshes(time_of(stage, time_code))
    meshes.add(start)
    if not meshes.placed.parts:
        where = "it" if start.IsPseudoRoot() else f"its prim {start.GetPath()}"
        words = meshes.placed.left_out_words
        others = f" Left out: {words}." if words else ""
        raise MeshError(
            f"{where} holds no mesh that is active, visible and of purpose default or render.{others} "
            f"{_remedy(stage)}"
        )
    return packed_surface(joined(meshes.placed.parts, meshes.notes()))


def content_of_picture(path: str) -> bytes:
    """Return the content of a picture within a package, `model.usdz[picture.png]`."""
    return bytes(Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path)).GetBuffer())


@dataclass
class StageLayers:
    """The files of a stage, found without composing it; `size` is of all and the stage, bytes."""

    root: str
    files: dict[str, None] = field(default_factory=dict)
    size: int = 0

    def open_all(self) -> None:
        """Find all layers. Raises MissingInputError, or MeshError for too many of them."""
        self.size = InputFile(Path(self.root), MOST_BYTES).size()
        seen, waiting = {self.root}, [self.root]
        while waiting:
            name = waiting.pop()
            for layer in _layers_named_in(name):
                if layer in seen:
                    continue
                self._require_file(layer, name)
                seen.add(layer)
                waiting.append(layer)
                if len(seen) > _MOST_LAYERS:
                    raise MeshError(f"it refers to over {_MOST_LAYERS} layers. Flatten the stage.")

    def _require_file(self, layer: str, named_in: str) -> None:
        """Note the file that holds a layer. Raises MissingInputError where it is no regular file."""
        package, inner = Ar.SplitPackageRelativePathOuter(layer)
        file = package if inner else layer
        if file == self.root or file in self.files:
            return
        try:
            self.size += InputFile(Path(file), MOST_BYTES).size()
        except FlowsculptError as error:
            raise MissingInputError(f"its layer {Path(named_in).name} refers to {error}") from None
        self.files[file] = None


def _layers_named_in(name: str) -> Iterator[str]:
    """Yield the absolute paths of the layers that a layer refers to."""
    layer = Sdf.Layer.FindOrOpen(name)
    if layer is None:
        raise ValueError(f"{Path(name).name} is not a USD layer")
    for asset in (*layer.GetCompositionAssetDependencies(), *_clips_of(layer)):
        if asset:
            yield layer.ComputeAbsolutePath(asset)


def _clips_of(layer: Sdf.Layer) -> Iterator[str]:
    """Yield the files that the value clips of a layer's prims name."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        spec = layer.GetPrimAtPath(path) if path.IsPrimPath() else None
        sets = spec.GetInfo("clips") if spec is not None and spec.HasInfo("clips") else {}
        for clips in sets.values():
            if not isinstance(clips, dict):
                raise MeshError(f"{path}: its value clips are not a dictionary")
            if clips.get("templateAssetPath"):
                yield from _clips_of_template(clips, path)
            yield from (asset.path for asset in clips.get("assetPaths") or ())
            manifest = clips.get("manifestAssetPath")
            if manifest is not None:
                yield manifest.path


def _clips_of_template(clips: Mapping[str, Any], path: Sdf.Path) -> Iterator[str]:
    """Yield the files of numbered value clips: `clip.###.usd`, or `clip.##.##.usd` with fractions."""
    template, found = clips["templateAssetPath"], None
    start, end, stride = (
        clips.get(name, 0.0) for name in ("templateStartTime", "templateEndTime", "templateStride")
    )
    if isinstance(template, str):
        found = re.search(r"(#+)(?:\.(#+))?(?=[^#]*$)", template)
    numbers = all(isinstance(value, float | int) and math.isfinite(value) for value in (start, end, stride))
    if found is None or not numbers or stride <= 0.0 or (end - start) / stride > _MOST_LAYERS:
        raise MeshError(f"{path}: the template of its value clips and its times do not fit. Export it again.")
    decimals = len(found[2] or "")
    width = len(found[1]) + (1 + decimals if decimals else 0)
    for k in range(math.floor((end - start) / stride + 1e-9) + 1):
        number = f"{start + k * stride:0{width}.{decimals}f}"
        yield template[: found.start()] + number + template[found.end() :]


def _opened(path: str) -> Usd.Stage:
    """Open a stage. Raises MeshError where its layers do not compose."""
    stage = Usd.Stage.Open(path)
    errors = stage.GetCompositionErrors()
    if errors:
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise MeshError(f"its layers do not compose{more}: {one_line(str(errors[0]), path)}")
    return stage


def time_of(stage: Usd.Stage, time_code: float | None) -> Usd.TimeCode:
    """Return the time at which a stage is read: by default its start."""
    if time_code is not None:
        return Usd.TimeCode(time_code)
    has_range = stage.HasAuthoredTimeCodeRange()
    return Usd.TimeCode(stage.GetStartTimeCode()) if has_range else Usd.TimeCode.EarliestTime()


def start_of(stage: Usd.Stage, prim: str | None) -> Usd.Prim:
    """Return the prim whose meshes are read. Raises MeshError where there is none of that path."""
    if prim is None:
        default = stage.GetDefaultPrim()
        return default if default else stage.GetPseudoRoot()
    named = stage.GetPrimAtPath(prim) if Sdf.Path.IsValidPathString(prim) and prim[:1] == "/" else None
    if not named:
        known = [str(other.GetPath()) for other in stage.Traverse()]
        raise MeshError(f"it has no prim {shorten(prim)}. {suggest(prim, known) if known else ''}".rstrip())
    return named


def _remedy(stage: Usd.Stage) -> str:
    """Return a sentence that names prims with meshes, where the stage has some."""
    meshes = [str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not meshes:
        return "Convert it to meshes in the program that made it."
    return f"Write prim: {shorten(meshes[0])}, which is a mesh."


def one_line(text: str, path: str) -> str:
    """Return what USD says on one line, with files by their names and without names of its C++ code."""
    plain = text.replace(f"{Path(path).parent}/", "").partition(" matching pxrInternal")[0]
    return textwrap.shorten(plain, 200, placeholder="…")
