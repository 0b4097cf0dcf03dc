"""Export rigid copies as a USD stage of instances: one shape, and where each copy is at each frame.

renders/<shot>/usd/<shot>.instances.usda   what other programs open: camera, lights, floor and materials
renders/<shot>/usd/<shot>.instances.usdc   the shape, and the time samples of its copies

Of several subjects each has a file, <shot>.<subject>.instances.usdc. Readers blend neighbouring samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Sdf, UsdGeom, Vt

from pipeline.animation import MeshFrame
from pipeline.animation.loop import animate
from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.errors import UsageError
from pipeline.mesh.placed_copies import Placements
from pipeline.plugins.interchange.exported_frame import KeyedFiles
from pipeline.plugins.interchange.one_mesh import OneMesh
from pipeline.plugins.interchange.unifying import Unification
from pipeline.plugins.interchange.usd_export import write_layer
from pipeline.plugins.interchange.usd_one_mesh import OneMeshFile, OneMeshStage, add_mesh
from pipeline.production.request.shading import vertex_motion
from pipeline.production.stages import EXPORT
from pipeline.production.store.store import key_of

SHAPE = "shape"
"""The name of the prim that all copies are instances of."""


class _Copies(NamedTuple):
    """The copies of a frame, and their velocities (N, 3) and angular velocities (N, 3), per second."""

    placements: Placements
    velocities: Vectors
    turning: Vectors


@dataclass(frozen=True, eq=False)
class Instances:
    """The rigid copies of a subject: a shape in the place of its first copy at rest, without its size.

    shape    its mesh at its own origin
    colours  linear Rec.709 (N, 3) of the copies; None where they have one colour, or the shape has its own
    """

    mesh: OneMesh
    shape: OneMesh
    colours: Floats | None
    frames: dict[int, MeshFrame]
    unification: Unification

    @classmethod
    def of(cls, unification: Unification, began: Callable[[str, int], Callable[[], None]]) -> Instances:
        """Return the copies of a subject. Raises UsageError where patterns or pictures differ on them."""
        motion, numbers = unification.request.shot.motion, unification.request.requested
        mesh = unification.one_mesh(began)
        frames = {f.number: f for f in takewhile(lambda f: f.number <= max(numbers), animate(motion))}
        count = len(_placed(frames[numbers[0]]))
        vertices, faces = len(mesh.rest) // count, mesh.faces[: len(mesh.faces) // count]
        corners = mesh.corner_normals[: len(faces)]

        def shared(values: AnyArray | None) -> AnyArray | None:
            """Return what the first copy has, if all have the same."""
            if values is None:
                return None
            rows = values.reshape(count, -1, *values.shape[1:])
            return rows[0] if np.allclose(rows, rows[:1], atol=1e-5) else None

        colours, texture = shared(mesh.colours), shared(mesh.texture)
        of_each = None
        if mesh.colours is not None and colours is None:
            rows = mesh.colours.reshape(count, vertices, 3)
            of_each = rows[:, 0] if np.allclose(rows, rows[:, :1], atol=1e-5) else None
        if mesh.paint is not None or (texture is None) != (mesh.texture is None):
            raise UsageError(
                f"{unification.name} has paint or pictures, which its copies do not share. {REMEDY}"
            )
        if mesh.colours is not None and colours is None and of_each is None:
            raise UsageError(f"{unification.name} has a pattern over all its copies. {REMEDY}")
        own = frames[motion.frames.first].own
        used = np.unique(corners)
        shape = replace(
            mesh,
            frames=(motion.frames.first,),
            faces=faces,
            corner_normals=np.searchsorted(used, corners).astype(np.int32),
            creases=mesh.creases[(mesh.creases < vertices).all(axis=1)],
            rest=own.vertices,
            points_at=lambda number: own.vertices,
            velocities_at=lambda number: np.zeros_like(own.vertices),
            colours=colours,
            texture=texture,
        )
        return cls(mesh, shape, of_each, frames, unification)

    def at(self, number: int) -> _Copies:
        """Return the copies of a frame."""
        frame = self.frames[number]
        placements = _placed(frame)
        points = frame.mesh.vertices.reshape(len(placements), -1, 3)
        moved = vertex_motion(self.unification.request.shot.motion, frame).velocity()
        return _Copies(placements, *rigid_velocities(points, moved.reshape(points.shape), placements.origins))


REMEDY = "Leave out --instances"


def require_rigid(parts: Iterable[Unification]) -> None:
    """Raise UsageError for a subject without rigid copies."""
    for part in parts:
        if not part.request.shot.motion.is_rigid:
            raise UsageError(f"{part.name} has no rigid copies (copies: {{rigid: true}}). {REMEDY}")


def _placed(frame: MeshFrame) -> Placements:
    assert frame.copies is not None, "rigid copies have placements"
    return frame.copies


def rigid_velocities(points: AnyArray, moved: AnyArray, origins: Points) -> tuple[Vectors, Vectors]:
    """Return velocities (N, 3) at origins (N, 3) and angular velocities (N, 3), radians, of rigid bodies.

    points, moved  vertices (N, V, 3) and their velocities

    They are those that differ least from the vertices' own.
    """
    middle, mean = points.mean(axis=1), moved.mean(axis=1)
    away, speed = points - middle[:, None], moved - mean[:, None]
    inertia = np.einsum("nvi,nvi->n", away, away)[:, None, None] * np.eye(3)
    inertia = inertia - np.einsum("nvi,nvj->nij", away, away)
    turning = np.linalg.solve(inertia, np.cross(away, speed).sum(axis=1)[..., None])[..., 0]
    return mean + np.cross(turning, origins - middle), turning


def write_instances(path: Path, prim: str, copies: Instances, passed: Callable[[], None]) -> None:
    """Write the layer of a point instancer with its shape. Raises MachineError where the disk refuses."""
    mesh = copies.mesh
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.timeCodesPerSecond = layer.framesPerSecond = float(mesh.rate.fps)
    layer.startTimeCode, layer.endTimeCode = float(mesh.frames[0]), float(mesh.frames[-1])
    spec = Sdf.CreatePrimInLayer(layer, prim)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, "PointInstancer"
    place = f"{prim}/{SHAPE}"
    add_mesh(layer, place, copies.shape)
    shape = layer.GetPrimAtPath(place)
    for name, kind, value in (
        ("subdivisionScheme", Sdf.ValueTypeNames.Token, UsdGeom.Tokens.none),
        ("doubleSided", Sdf.ValueTypeNames.Bool, True),
    ):
        Sdf.AttributeSpec(shape, name, kind, Sdf.VariabilityUniform).default = value
    Sdf.RelationshipSpec(spec, "prototypes").targetPathList.explicitItems = [place]
    count = len(copies.at(mesh.frames[0]).placements)
    for name, kind, value in (
        ("protoIndices", Sdf.ValueTypeNames.IntArray, Vt.IntArray(count, 0)),
        ("ids", Sdf.ValueTypeNames.Int64Array, Vt.Int64Array(range(count))),
    ):
        Sdf.AttributeSpec(spec, name, kind).default = value
    if copies.colours is not None:
        colour = Sdf.AttributeSpec(spec, "primvars:displayColor", Sdf.ValueTypeNames.Color3fArray)
        colour.SetInfo("interpolation", UsdGeom.Tokens.vertex)
        colour.default = Vt.Vec3fArray.FromNumpy(copies.colours.astype(np.float32))
    types = Sdf.ValueTypeNames
    sampled = {
        "positions": types.Point3fArray,
        "orientations": types.QuathArray,
        "scales": types.Float3Array,
        "velocities": types.Vector3fArray,
        "angularVelocities": types.Vector3fArray,
        "extent": types.Float3Array,
    }
    for name, kind in sampled.items():
        Sdf.AttributeSpec(spec, name, kind)
    for number in mesh.frames:
        for name, value in _samples(copies.at(number), mesh.points_at(number)):
            layer.SetTimeSample(f"{prim}.{name}", float(number), value)
        passed()
    write_layer(path, layer)


def _samples(copies: _Copies, points: Points) -> Iterator[tuple[str, Any]]:
    """Yield the attributes of a frame."""
    placements, sizes = copies.placements, copies.placements.sizes
    turns = (placements.matrices[:, :, :3] / sizes[:, None, None]).swapaxes(1, 2)  # USD multiplies rows
    yield "positions", _triples(placements.origins)
    yield (
        "orientations",
        Vt.QuathArray([Gf.Quath(Gf.Matrix3d(turn).ExtractRotation().GetQuat()) for turn in turns.tolist()]),
    )
    yield "scales", _triples(np.repeat(sizes[:, None], 3, axis=1))
    yield "velocities", _triples(copies.velocities)
    yield "angularVelocities", _triples(np.degrees(copies.turning))
    yield "extent", _triples(np.stack([points.min(axis=0), points.max(axis=0)]))


def _triples(values: AnyArray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


@dataclass(frozen=True, eq=False)
class InstancesFile(OneMeshFile):
    """The copies of one subject of a stage: the layer with their time samples."""

    schema = UsdGeom.PointInstancer

    @property
    def name(self) -> str:
        """The file's name."""
        return f"{self.request.motion_folders.part_name}.instances.usdc"

    @property
    def key(self) -> str:
        """The key of the file."""
        return key_of(EXPORT.recipe, "instances", self.prim, self.unification.key)


@dataclass(frozen=True, eq=False)
class InstancesStage(OneMeshStage):
    """A shot of rigid copies as a USD stage of instances. Files that are current are kept."""

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self.request.name}.instances.keys.json", self.store)

    @property
    def path(self) -> Path:
        """The path of the stage that other programs open."""
        return self.folder / f"{self.request.name}.instances.usda"

    @cached_property
    def _sculptures(self) -> tuple[InstancesFile, ...]:
        return tuple(InstancesFile(part.request, self.store, self.files, part) for part in self.parts)

    def _write_mesh(self, file: OneMeshFile, passed: Callable[[], None]) -> None:
        copies = Instances.of(file.unification, self.began)
        self.files.write(file.name, file.key, lambda draft: write_instances(draft, file.prim, copies, passed))
