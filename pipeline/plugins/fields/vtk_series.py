"""Surfaces of `.pvd` files over time: each time has files of its own, which are read when it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flowsculpt import MeshError, MissingInputError
from flowsculpt.api.meshes import FileSurface, Floats, MovingSurface, ScenePart, SourceFiles
from flowsculpt.pipeline.plugins.fields.vtk_surfaces import collection, files_and_digests, surface_of


@dataclass
class SurfaceSeries:
    """A `MovingSurface` of files with times.

    members  the files of each time
    """

    path: Path
    files: SourceFiles
    times: Floats
    members: list[list[Path]]
    is_fixed: bool = False
    rate: float | None = None
    is_in_frames: bool = False
    is_continuous: bool = False

    def at(self, seconds: float) -> FileSurface:
        place = np.searchsorted(self.times, seconds, side="right") - 1
        files = self.members[int(np.clip(place, 0, len(self.times) - 1))]
        try:
            surface = surface_of(files, self.path)
        except MeshError as error:
            raise MeshError(f"{self.path}: at {seconds:.6g} s: {error}") from None
        known = dict(self.files.files)
        if any(known[file] != digest for file, digest in files_and_digests(self.path, files)):
            raise MissingInputError(f"{self.path}: a file that it names changed while it was read; run again")
        return surface

    def close(self) -> None:
        """End nothing: no process reads it."""


def open_series(path: Path, part: ScenePart | None) -> MovingSurface:
    """Open a `.pvd`: see `FileFormat.motion`. Faces stay if they do at its first, second and last time.

    Raises MeshError, or MissingInputError where a file is not there.
    """
    entries = collection(path)
    if len(entries) < 2:
        raise MeshError("it has one time, so nothing moves in it. Show it as a model.")
    members = [files for _, files in entries]
    every = (file for files in members for file in files)
    times = np.array([time for time, _ in entries])
    series = SurfaceSeries(path, SourceFiles.of(files_and_digests(path, every)), times, members)
    first, *others = (series.at(times[place]) for place in (0, 1, -1))
    series.is_fixed = all(
        len(first.points) == len(other.points)
        and np.array_equal(first.offsets, other.offsets)
        and np.array_equal(first.corners, other.corners)
        for other in others
    )
    return series
