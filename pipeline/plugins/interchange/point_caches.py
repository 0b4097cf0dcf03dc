"""Point caches, PC2 and MDD: the points of one mesh for all frames, for Blender, Maya and Cinema 4D.

A cache has no triangles: an OBJ of the first frame next to it has them, with its vertices in the same order.

renders/<shot>/caches/<shot>.pc2              the points
renders/<shot>/caches/<shot>.pc2.obj          the mesh
renders/<shot>/caches/<shot>.pc2.keys.json    what they were made from

PC2, little-endian: "POINTCACHE2" and a zero byte, int32 version 1, int32 points, float32 first frame, float32
frames from sample to sample, int32 samples; then float32 x y z of each point of each sample.

MDD, big-endian: int32 samples, int32 points, float32 seconds of each sample from the first one; then float32
x y z of each point of each sample.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.files import disk_errors
from flowsculpt.api.frames import FrameRange, key_of
from flowsculpt.pipeline.plugins.interchange.exported_frame import KeyedFiles
from flowsculpt.pipeline.plugins.interchange.model_export import write_obj
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import Began
from flowsculpt.pipeline.plugins.interchange.unifying import Unification, exported

_VERSION = 1  # of both formats as they are written here


def write_pc2(path: Path, mesh: OneMesh, began: Began) -> None:
    """Write the points of all frames as PC2; `began` counts them. Raises MachineError on a full disk.

    Raises UsageError for frames that are not evenly spaced.
    """
    step = even_step(mesh.frames)
    points, samples = len(mesh.rest), len(mesh.frames)
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, mesh.frames[0], step, samples)
    _write(path, mesh, header, "<f4", began)


def write_mdd(path: Path, mesh: OneMesh, began: Began) -> None:
    """Write the points of all frames as MDD; `began` counts them. Raises MachineError on a full disk.

    Raises UsageError for frames that are not evenly spaced, which readers take them for.
    """
    even_step(mesh.frames)
    first, samples = mesh.frames[0], len(mesh.frames)
    seconds = np.array([mesh.rate.seconds(number - first) for number in mesh.frames], ">f4")
    header = struct.pack(">ii", samples, len(mesh.rest)) + seconds.tobytes()
    _write(path, mesh, header, ">f4", began)


def even_step(frames: Sequence[int]) -> int:
    """Return the frames from one sample to the next. Raises UsageError where they differ."""
    steps = set(np.diff(frames).tolist()) or {1}
    if len(steps) > 1 or min(steps) < 1:
        raise UsageError(
            f"frames {FrameRange.of(frames)} are not evenly spaced, as this format has them; write a range "
            "such as 1-48 or 1-48x2"
        )
    return int(steps.pop())


def _write(path: Path, mesh: OneMesh, header: bytes, kind: str, began: Began) -> None:
    passed = began("exporting", len(mesh.frames))
    with disk_errors(path), path.open("wb") as file:
        file.write(header)
        for number in mesh.frames:
            file.write(mesh.points_at(number).astype(kind).tobytes())
            passed()


FORMS = {"pc2": write_pc2, "mdd": write_mdd}


@dataclass(frozen=True, eq=False)
class PointCacheExport:
    """The point cache of one mesh, and its OBJ. Files that are current are kept."""

    unification: Unification
    folder: Path
    form: str

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        name = f"{self.unification.name}.{self.form}.keys.json"
        return KeyedFiles(self.folder, name, self.unification.store)

    @property
    def path(self) -> Path:
        """The path of the cache."""
        return self.folder / self._names[0]

    @property
    def _names(self) -> tuple[str, str]:
        return f"{self.unification.name}.{self.form}", f"{self.unification.name}.{self.form}.obj"

    @cached_property
    def _key(self) -> str:
        return key_of(self.unification.key, self.form, _VERSION)

    @property
    def is_current(self) -> bool:
        """True if both files are there, whole, and of this mesh."""
        return all(self.files.is_current(name, self._key) for name in self._names)

    def write(self, began: Began) -> OneMesh | None:
        """Write both files and return the mesh, or do nothing where they are current and return None.

        Raises what `Unification.one_mesh` raises, UsageError for frames that are not evenly spaced, and
        MachineError where the disk refuses.
        """
        even_step(self.unification.request.requested)
        cache, surface = self._names
        with self.files.changing():
            if self.is_current:
                return None
            mesh = self.unification.one_mesh(began)
            self.files.write(cache, self._key, lambda path: FORMS[self.form](path, mesh, began))
            frame = exported(mesh, mesh.frames[0])
            self.files.write(surface, self._key, lambda path: write_obj(path, frame))
        return mesh
