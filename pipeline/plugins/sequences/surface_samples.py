"""Samples of a moving surface: numbered files, or one file with an animation, each read when it is shown."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

from flowsculpt import MeshError, MissingInputError
from flowsculpt.api.meshes import FileSurface, Floats, ModelFile, MovingSurface, ScenePart

Files = tuple[tuple[Path, str], ...]

KEPT = 4
"""Samples that are kept in memory: those around a frame."""


class SurfaceSamples(ABC):
    """Surfaces at ascending times, float64 (T,), seconds of the files."""

    times: Floats

    @abstractmethod
    def files(self, sample: int) -> Files:
        """Return the files of a sample and their digests."""

    @abstractmethod
    def content(self, sample: int) -> str:
        """Return a text that differs from that of every other surface, as keys of frames have it."""

    @abstractmethod
    def name(self, sample: int) -> str:
        """Return the name of a sample in messages."""

    @abstractmethod
    def model(self, sample: int) -> ModelFile:
        """Return the model that a sample is, as a still one."""

    @abstractmethod
    def surface(self, sample: int) -> FileSurface:
        """Return the polygons of a sample. Raises MeshError, MissingInputError."""

    def still(self, sample: int) -> FileSurface:
        """Return the polygons of the model of a sample."""
        return self.surface(sample)

    @property
    def up(self) -> str | None:
        """The axis that points up; None where the files do not say it."""
        return None

    @property
    def is_fixed(self) -> bool | None:
        """Whether all samples have the same faces; None where only reading them tells."""
        return None

    def between(self, seconds: float) -> FileSurface | None:
        """Return the polygons at a time between samples, where the file itself says them; else None."""
        return None


@dataclass(frozen=True, eq=False)
class NumberedSamples(SurfaceSamples):
    """Numbered files, each with one surface.

    part  of scenes whose parts have names
    """

    times: Floats
    paths: Sequence[Path]
    part: ScenePart | None = None

    @property
    def up(self) -> str | None:
        return self.model(0).files(keeps_digest=True).up

    def files(self, sample: int) -> Files:
        """Return the files of a sample as they were at first: keys have these digests."""
        if sample not in self._known:
            self._known[sample] = self.model(sample).files(keeps_digest=True).files
        return self._known[sample]

    @cached_property
    def _known(self) -> dict[int, Files]:
        return {}

    def content(self, sample: int) -> str:
        return joint(self.files(sample)) + _part_words(self.model(sample).part)

    def name(self, sample: int) -> str:
        return self.paths[sample].name

    def model(self, sample: int) -> ModelFile:
        model = ModelFile(self.paths[sample])
        return ModelFile(model.path, self.part) if model.names_parts else model

    def surface(self, sample: int) -> FileSurface:
        return _read(self.model(sample), joint(self.files(sample)))


@dataclass(frozen=True, eq=False)
class MovingSamples(SurfaceSamples):
    """A file with an animation.

    moving  its surface over time
    begins  its time in the first frame of the shot, seconds; `times` count from there
    """

    times: Floats
    moving: MovingSurface
    file: ModelFile
    begins: float

    @property
    def up(self) -> str | None:
        return self.moving.files.up

    @property
    def is_fixed(self) -> bool | None:
        return self.moving.is_fixed

    def files(self, sample: int) -> Files:
        return self.moving.files.files

    def content(self, sample: int) -> str:
        seconds = float(self.begins + self.times[sample])
        return f"{joint(self.files(sample))}{_part_words(self.file.part)} at {seconds!r} s"

    def name(self, sample: int) -> str:
        return f"{self.file.path.name} at {self.begins + self.times[sample]:g} s"

    def model(self, sample: int) -> ModelFile:
        return self.file

    def still(self, sample: int) -> FileSurface:
        return _read(self.file, joint(self.file.files(keeps_digest=True).files))

    def surface(self, sample: int) -> FileSurface:
        return _moved(self, float(self.times[sample]))

    def between(self, seconds: float) -> FileSurface | None:
        return _moved(self, seconds) if self.moving.is_continuous else None


def _part_words(part: ScenePart | None) -> str:
    """Return the names of a part of a scene after a space; nothing for the whole scene."""
    return "" if part is None else f" {part.prim!r} {part.animation!r}"


@lru_cache(maxsize=KEPT)
def _moved(samples: MovingSamples, seconds: float) -> FileSurface:
    at = samples.begins + seconds
    return _with_faces(samples.moving.at(at), f"{samples.file.path}: at {at:.6g} s")


def joint(files: Files) -> str:
    """Return the digests of files as one text."""
    return " ".join(digest for _, digest in files)


@lru_cache(maxsize=KEPT)
def _read(model: ModelFile, digest: str) -> FileSurface:
    """Return the polygons of a model. Raises MissingInputError where its files do not have the digest."""
    reader = model.reader
    readers = {} if reader is None else {model.path.suffix.lower().lstrip("."): reader.reads(model.part)}
    surface = model.read_by(readers, "a mesh format")
    if joint(model.files(keeps_digest=True).files) != digest:
        raise MissingInputError(
            f"{model.path}: it was changed since the work was planned; run again once it is written"
        )
    return _with_faces(surface, str(model.path))


def _with_faces(surface: FileSurface, place: str) -> FileSurface:
    """Return a surface. Raises MeshError, with its place, where it has no faces."""
    if not len(surface.corners):
        more = "".join(f"; {note}" for note in surface.notes)
        raise MeshError(
            f"{place}: it has no faces, so its frame shows nothing{more}. Leave the frame out of the "
            "shot's frames, or export it again."
        )
    return surface
