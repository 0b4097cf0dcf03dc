"""Export rigid copies as a USD stage of instances: one shape, and where each copy is at each frame.

renders/<shot>/usd/<shot>.instances.usda   what other programs open: camera, lights, floor and materials
renders/<shot>/usd/<shot>.instances.usdc   the shape, and the time samples of its copies

Of several subjects each has a file, <shot>.<subject>.instances.usdc. Readers blend neighbouring samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdGeom, Vt

from flowsculpt.api.frames import key_of
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.copy_instances import Instances, PlacedCopies
from flowsculpt.pipeline.plugins.interchange.exported_frame import EXPORT
from flowsculpt.pipeline.plugins.interchange.usd_export import write_layer
from flowsculpt.pipeline.plugins.interchange.usd_one_mesh import (
    OneMeshFile,
    OneMeshStage,
    add_mesh,
    timed_layer,
)

SHAPE = "shape"
"""The name of the prim that all copies are instances of."""


def write_instances(path: Path, prim: str, copies: Instances, passed: Callable[[], None]) -> None:
    """Write the layer of a point instancer with its shape. Raises MachineError where the disk refuses."""
    mesh = copies.mesh
    layer = timed_layer(mesh)
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
    count = len(copies.placements(mesh.frames[0]))
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


def _samples(copies: PlacedCopies, points: Floats) -> Iterator[tuple[str, Any]]:
    """Yield the attributes of a frame."""
    placements, sizes = copies.placements, copies.placements.sizes
    turns = placements.rotations.swapaxes(1, 2)  # USD multiplies rows
    yield "positions", _triples(placements.origins)
    yield (
        "orientations",
        Vt.QuathArray([Gf.Quath(Gf.Matrix3d(turn).ExtractRotation().GetQuat()) for turn in turns.tolist()]),
    )
    yield "scales", _triples(np.repeat(sizes[:, None], 3, axis=1))
    yield "velocities", _triples(copies.velocities)
    yield "angularVelocities", _triples(np.degrees(copies.turning))
    yield "extent", _triples(np.stack([points.min(axis=0), points.max(axis=0)]))


def _triples(values: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


@dataclass(frozen=True, eq=False)
class InstancesFile(OneMeshFile):
    """The copies of one subject of a stage: the layer with their time samples."""

    schema = UsdGeom.PointInstancer
    form = ".instances"

    @property
    def key(self) -> str:
        """The key of the file."""
        return key_of(EXPORT.recipe, "instances", self.prim, self.unification.key)


@dataclass(frozen=True, eq=False)
class InstancesStage(OneMeshStage):
    """A shot of rigid copies as a USD stage of instances. Files that are current are kept."""

    form = InstancesFile.form
    sculpture = InstancesFile

    def _write_mesh(self, file: OneMeshFile, passed: Callable[[], None]) -> None:
        copies = Instances.of(file.unification, self.began)
        self.files.write(file.name, file.key, lambda draft: write_instances(draft, file.prim, copies, passed))
