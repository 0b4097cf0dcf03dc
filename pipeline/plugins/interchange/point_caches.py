"""Files of moving points beside a model with their faces: PC2 (3ds Max) and MDD (LightWave).

A sample is read at a time. Times of PC2 are frames, of a length that the file does not say; those of MDD are
seconds. PC2 is little-endian, MDD big-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from flowsculpt import MeshError, MissingInputError
from flowsculpt.api import plugins
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import FileSurface, Floats, ModelFile, MovingSurface, ScenePart, SourceFiles
from flowsculpt.pipeline.plugins.interchange.moving_files import LARGEST_CACHE, require_times, state_of
from flowsculpt.pipeline.plugins.interchange.scene_readers import early_end

_PC2, _PC2_HEAD = b"POINTCACHE2\0", "<12siiffi"


@dataclass
class PointCache:
    """A `MovingSurface` of points in a file, and of the faces of a model.

    start  byte at which the first sample begins
    kind   numpy's type of its numbers
    """

    path: Path
    files: SourceFiles
    times: Floats
    rate: float | None
    is_in_frames: bool
    faces: FileSurface
    start: int
    kind: str
    state: object
    is_fixed: bool = True
    is_continuous: bool = False

    def at(self, seconds: float) -> FileSurface:
        sample = int(np.clip(np.searchsorted(self.times, seconds, "right") - 1, 0, len(self.times) - 1))
        count = len(self.faces.points)
        with InputFile(self.path, LARGEST_CACHE).open() as (file, _):
            file.seek(self.start + 12 * count * sample)
            content = file.read(12 * count)
        if state_of(self.files) != self.state or len(content) < 12 * count:
            raise MissingInputError(f"{self.path}: it changed, or its model, while it was read; run again")
        points = np.frombuffer(content, self.kind).reshape(-1, 3).astype(np.float64)
        wrong = ~np.isfinite(points).all(axis=1)
        if wrong.any():
            fact = f"vertex {int(np.argmax(wrong))} is not finite"
            raise MeshError(f"{self.path}: sample {sample}: {fact}. Export it again.")
        return self.faces._replace(points=points)

    def close(self) -> None:
        """End nothing: no process reads it."""


def open_pc2(path: Path, other: ScenePart | Path | None) -> MovingSurface:
    """Open a PC2 and the model with its faces: see `FileFormat.motion`."""
    return _opened(path, other, _pc2, "<f4", is_in_frames=True)


def open_mdd(path: Path, other: ScenePart | Path | None) -> MovingSurface:
    """Open an MDD and the model with its faces: see `FileFormat.motion`."""
    return _opened(path, other, _mdd, ">f4", is_in_frames=False)


def _opened(
    path: Path,
    other: ScenePart | Path | None,
    head: Callable[[BinaryIO, int], tuple[int, Floats, int]],
    kind: str,
    is_in_frames: bool,
) -> MovingSurface:
    model = other if isinstance(other, Path) else _beside(path)
    with InputFile(path, LARGEST_CACHE).open() as (file, size):
        count, times, start = head(file, size)
        present = (size - start) // (12 * count) if count > 0 else 0
    if count <= 0:
        raise MeshError("its header promises no points. Export it again.")
    if present < len(times):
        raise early_end(len(times), "sample", present)
    require_times(times, "Export it with its animation.")
    own, found = ModelFile(model), ModelFile(model).files()
    reader = own.reader
    faces = own.read_by({} if reader is None else {model.suffix.lower()[1:]: reader.read}, "a mesh format")
    if len(faces.points) != count:
        fact = f"it has {count} points, and {model.name} has {len(faces.points)} vertices"
        raise MeshError(f"{fact}. Export both of one mesh, in the order of its vertices.")
    files = SourceFiles.of([(path, InputFile(path).digest()), *found.files], found.up)
    return PointCache(path, files, times, None, is_in_frames, faces, start, kind, state_of(files))


def _pc2(file: BinaryIO, size: int) -> tuple[int, Floats, int]:
    """Return the number of points, the frames of the samples, and where the first begins."""
    content = file.read(struct.calcsize(_PC2_HEAD))
    if len(content) < struct.calcsize(_PC2_HEAD) or not content.startswith(_PC2):
        raise ValueError("it does not begin as PC2 does")
    _, _, count, first, step, samples = struct.unpack(_PC2_HEAD, content)
    if not 0 < samples <= size or not 0.0 < step < np.inf:
        raise ValueError(f"its header promises {samples} samples, each {step:g} frames after the last")
    return count, first + float(step) * np.arange(samples), len(content)


def _mdd(file: BinaryIO, size: int) -> tuple[int, Floats, int]:
    """Return the number of points, the seconds of the samples, and where the first begins."""
    content = file.read(8)
    samples, count = struct.unpack(">ii", content) if len(content) == 8 else (0, 0)
    times = file.read(4 * samples) if 0 < 4 * samples <= size else b""
    if not times or len(times) < 4 * samples:
        raise ValueError("it does not begin as MDD does")
    return count, np.frombuffer(times, ">f4").astype(np.float64), 8 + len(times)


def _beside(path: Path) -> Path:
    """Return the one model of the same name. Raises MeshError for none and several."""
    suffixes = [suffix for suffix in plugins().readers("surface") if path.with_suffix(f".{suffix}").exists()]
    if len(suffixes) == 1:
        return path.with_suffix(f".{suffixes[0]}")
    there = f"there are {', '.join(suffixes)} of its name" if suffixes else "no model has its name"
    raise MeshError(f"it holds points without faces, and {there}. Name the mesh: file with its faces.")
