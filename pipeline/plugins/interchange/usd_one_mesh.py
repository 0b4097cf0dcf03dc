"""Export a shot as a USD stage with one mesh: topology once, positions and normals at each frame.

renders/<shot>/usd/<shot>.one_mesh.usda   what other programs open: camera, lights, floor and materials
renders/<shot>/usd/<shot>.one_mesh.usdc   the mesh with its time samples

Of several subjects each has a mesh file, <shot>.<subject>.one_mesh.usdc. Readers blend neighbouring samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from pxr import Sdf

from flowsculpt.api.frames import key_of
from flowsculpt.pipeline.plugins.interchange.exported_frame import EXPORT, ExportedFrame
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import Began
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.plugins.interchange.usd_export import (
    SampledAttribute,
    SculptureFiles,
    UsdExport,
    add_subsets,
    sampled_attributes,
    usd_array,
    write_layer,
)

_SAMPLED = ("points", "primvars:normals", "extent")  # what differs from frame to frame


def write_one_mesh(path: Path, prim: str, mesh: OneMesh, passed: Callable[[], None] = lambda: None) -> None:
    """Write the layer of a mesh: a prim with time samples of points, normals and extent.

    Raises FrameError where a frame cannot be read, MachineError where the disk refuses.
    """
    layer = timed_layer(mesh)
    add_mesh(layer, prim, mesh, passed)
    write_layer(path, layer)


def timed_layer(mesh: OneMesh) -> Sdf.Layer:
    """Return a layer without prims that has the rate and the frames of a mesh."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.timeCodesPerSecond = layer.framesPerSecond = float(mesh.rate.fps)
    layer.startTimeCode, layer.endTimeCode = float(mesh.frames[0]), float(mesh.frames[-1])
    return layer


def add_mesh(layer: Sdf.Layer, prim: str, mesh: OneMesh, passed: Callable[[], None] = lambda: None) -> None:
    """Add the prim of a mesh: of one frame its values, of several time samples of what differs."""
    attributes = _attributes(mesh)
    spec = Sdf.CreatePrimInLayer(layer, prim)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, "Mesh"
    declared = [attribute.spec(layer, prim) for attribute in attributes]
    add_subsets(layer, prim, attributes)
    for number in mesh.frames:
        frame = _export(mesh, number)
        for attribute, own in zip(attributes, declared, strict=True):
            if attribute.name in _SAMPLED or number == mesh.frames[0]:
                values = attribute.values(frame)
                assert values is not None, f"the mesh has {attribute.name}"
                held = usd_array(attribute.kind, values)
                if attribute.name in _SAMPLED and len(mesh.frames) > 1:
                    layer.SetTimeSample(own.path, float(number), held)
                else:
                    own.default = held
        passed()


def _attributes(mesh: OneMesh) -> tuple[SampledAttribute, ...]:
    """Return the attributes of one mesh: those of clips, without velocities and numbers of copies."""
    materials = 1 if mesh.paint is None else int(mesh.paint.materials.max(initial=0)) + 1
    attributes = sampled_attributes(
        False, mesh.colours is not None, mesh.texture is not None, materials=materials
    )
    kept = tuple(attribute for attribute in attributes if attribute.name != "velocities")
    if mesh.paint is None or (painted := mesh.paint.colours) is None:
        return kept
    by_corner = SampledAttribute(
        "primvars:displayColor", "Color3fArray", lambda _: painted.reshape(-1, 3), "faceVarying"
    )
    return tuple(by_corner if each.name == by_corner.name else each for each in kept)


@dataclass(frozen=True, eq=False)
class OneMeshFile(SculptureFiles):
    """One mesh of a stage: the layer with its time samples, and the picture that colours it."""

    unification: Unification

    form: ClassVar[str] = ".one_mesh"

    @property
    def name(self) -> str:
        """The file's name."""
        return f"{self.request.motion_folders.part_name}{self.form}.usdc"

    @property
    def attributes(self) -> tuple[SampledAttribute, ...]:
        """The attributes that the stage itself declares: none, for the layer does."""
        return ()

    @property
    def key(self) -> str:
        """The key of the file."""
        subsets = ["subsets"] if len(self.parts) > 1 else []
        return key_of(EXPORT.recipe, "one mesh", self.prim, self.unification.key, *subsets)

    def is_current(self) -> bool:
        """Tell whether the file is there, whole, and of this mesh."""
        return self.files.is_current(self.name, self.key)

    def refer(self, prim: Sdf.PrimSpec, numbers: tuple[int, ...]) -> None:
        """Refer to the file at the prim of the stage."""
        prim.referenceList.Prepend(Sdf.Reference(f"./{self.name}", self.prim))

    def write_others(self) -> None:
        """Write the pictures of the materials that have changed."""
        self.write_pictures()


@dataclass(frozen=True, eq=False)
class OneMeshStage(UsdExport):
    """A shot as a USD stage with one mesh of each subject. Files that are current are kept.

    parts  how the meshes are made
    began  called with the name of each part of that work and its number of frames
    """

    parts: tuple[Unification, ...]
    began: Began = lambda name, total: lambda: None

    form = OneMeshFile.form
    sculpture: ClassVar[type[OneMeshFile]] = OneMeshFile

    @cached_property
    def _sculptures(self) -> tuple[OneMeshFile, ...]:
        return tuple(self.sculpture(part.request, self.store, self.files, part) for part in self.parts)

    def stale(self) -> list[int]:
        """Return the frames to write: all of those of files that are not current, once for each."""
        return [n for file in self._sculptures if not file.is_current() for n in self.request.requested]

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the files that are not current, and the stage; return no messages.

        Raises MachineError where the disk refuses, FrameError where there are no cameras or a frame cannot be
        read.
        """
        framings = self.framings()
        with self.files.changing():
            for file in self._sculptures:
                if not file.is_current():
                    self._write_mesh(file, passed)
            self.write_stage(framings)
        return []

    def _write_mesh(self, file: OneMeshFile, passed: Callable[[], None]) -> None:
        mesh = file.unification.one_mesh(self.began)
        self.files.write(file.name, file.key, lambda draft: write_one_mesh(draft, file.prim, mesh, passed))

    def shown(self) -> list[int]:
        """Return the frames of the stage, in ascending order."""
        return sorted(self.request.requested)


def _export(mesh: OneMesh, number: int) -> ExportedFrame:
    """Return one mesh at a frame, without velocities."""
    frame = mesh.frame(number)
    return ExportedFrame(
        *(frame.points, mesh.faces, frame.normals, mesh.corner_normals, np.empty((0, 3)), mesh.rest),
        creases=mesh.creases,
        colours=mesh.colours,
        texture=mesh.texture,
        paint=mesh.paint,
    )
