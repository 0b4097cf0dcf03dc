"""The provenance of a published version: what it was made from, by which environment, and when."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import psutil

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api.files import CachedAnswer, InputFile, from_plain, to_plain
from flowsculpt.api.frames import (
    Folders,
    PipelineStage,
    PublishedVersion,
    QualityName,
    ShotSource,
)
from flowsculpt.api.shots import NAME_PATTERN

FILE = "provenance.json"
FORMAT = 2
VERSION = r"v[0-9]{3,6}"

_FORMER_QUALITIES = {"preview": "draft"}

_STAGES = ("simulate", "smooth_normals", "frame_camera", "render", "finish", "assemble")
"""The stages that a version comes from."""

PACKAGES = (
    "av",
    "drjit",
    "imageio",
    "llvmlite",
    "mitsuba",
    "numba",
    "numpy",
    "OpenImageIO",
    "pyoidn",
    "trimesh",
)
"""Packages that pixels come from."""


@dataclass(frozen=True)
class FrameRecord:
    """One published frame.

    file                       relative to the provenance
    mesh, normals, raw, frame  keys
    pixels                     SHA-256 of the picture's values, without the file around them
    sha256                     of the file
    seconds                    of rendering it, by part, if known
    """

    file: str
    mesh: str
    normals: str
    raw: str
    frame: str
    seed: int
    pixels: str
    sha256: str
    seconds: Mapping[str, float]


@dataclass(frozen=True)
class Provenance:
    """All that a version was made from, and the environment that made it.

    source   the shot file and what it rests on; its paths as `portable` gives them
    cameras  the key of all cameras
    movie    its file, key and SHA-256
    stages   versions of the stages that made it
    host     what it was published on
    timings  seconds by stage, as the runs that made it told them
    notes    the file of the shot's notes at that time and its SHA-256; empty if there were none
    patch    the version that it is a patch of, the frames of the patch, and the SHA-256 of that version's
             provenance; empty if all frames are from `source`
    """

    shot: str
    version: str
    title: str
    note: str
    published: str
    user: str
    quality: str
    size: tuple[int, int]
    rate: str
    variant: str
    source: ShotSource
    cameras: str
    frames: Mapping[int, FrameRecord]
    movie: Mapping[str, str]
    packages: Mapping[str, str]
    stages: Mapping[str, int]
    host: Mapping[str, Any]
    timings: Mapping[str, float]
    notes: Mapping[str, str] = field(default_factory=dict)
    patch: Mapping[str, str] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        return {"format": FORMAT, **to_plain(self)}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Provenance:
        """Raises KeyError, TypeError, ValueError or BadInputError for what is no provenance."""
        fields = {name: value for name, value in data.items() if name in cls.__dataclass_fields__}
        if data["format"] == 1:  # before stages had versions
            source = dict(data["script"])
            inputs = source.pop("pins")
            fields |= {"source": {**source, "inputs": inputs}, "stages": {}}
        elif data["format"] != FORMAT:
            raise ValueError
        base, dot, part = str(fields["quality"]).partition(".")
        fields["quality"] = f"{_FORMER_QUALITIES.get(base, base)}{dot}{part}"
        record = from_plain(cls, fields)
        _require_whole(record)
        return record

    @classmethod
    def read(cls, path: Path) -> Provenance:
        """Raises MissingInputError where it is not there, UsageError where it is none."""
        if not InputFile(path).is_there():
            raise MissingInputError(
                f"{path}: no such file; flowsculpt versions lists the published versions; each has a {FILE}"
            )
        InputFile(path).content()  # raises MissingInputError where it cannot be read
        record = CachedAnswer(path).load(cls.from_data)
        if record is None:
            raise UsageError(
                f"{path}: not the provenance of a published version, or cut short; use the one that "
                "flowsculpt publish wrote"
            )
        return record

    @property
    def content(self) -> tuple[str, ...]:
        """The keys of its frames and its movie: equal if two versions show the same."""
        return (*(self.frames[number].frame for number in sorted(self.frames)), self.movie["key"])

    def differences(self, variant: str) -> list[str]:
        """Return the differences of today's environment, each in a line; `variant` renders now."""
        lines, versions, machine = [], packages(), host()
        if variant != self.variant:
            lines.append(f"variant {variant} renders now, {self.variant} did then; pixels will differ")
        for name, then in self.packages.items():
            if (now := versions.get(name, "not there")) != then:
                lines.append(f"{name} is {now} now and was {then}; pixels may differ")
        for name, number in stage_versions().items():
            if (was := self.stages.get(name, "unknown")) != number:
                lines.append(f"stage {name} has version {number} now and had {was}; pixels may differ")
        for part in ("machine", "processor"):
            if machine[part] != (before := self.host.get(part)):
                lines.append(f"the {part} is {machine[part]} now and was {before}; last bits may differ")
        return lines


def _require_whole(record: Provenance) -> None:
    """Check what else readers rely on; names become those of folders. Raises KeyError or ValueError."""
    named = re.fullmatch(NAME_PATTERN, record.shot) and re.fullmatch(VERSION, record.version)
    known = QualityName.of(record.quality).is_known and record.source.name == record.shot
    if not (named and known and record.frames and isinstance(record.source.text, str)):
        raise ValueError
    files = [record.movie["file"], *(frame.file for frame in record.frames.values())]
    if any(Path(file).is_absolute() or ".." in Path(file).parts for file in files):
        raise ValueError
    is_patch = set(record.patch) in (set(), {"version", "frames", "sha256"})
    if not {"file", "key", "sha256"} <= set(record.movie) or not is_patch:
        raise KeyError
    if set(record.notes) not in (set(), {"file", "sha256"}):
        raise KeyError


def portable(source: ShotSource) -> ShotSource:
    """Return the source with paths relative to the working folder, so that a project may be moved."""
    inputs = tuple((_within(Path(path)), digest) for path, digest in source.inputs or ())
    return replace(source, path=Path(_within(source.path)), inputs=inputs or source.inputs)


def _within(path: Path) -> str:
    plain = Path(os.path.normpath(path.absolute()))
    return (plain.relative_to(Path.cwd()) if plain.is_relative_to(Path.cwd()) else plain).as_posix()


def published_folder(root: Path, shot: str) -> Path:
    """Return the folder of a shot's versions."""
    return Folders.of_root(root).published / shot


def records(root: Path, shot: str) -> Iterator[tuple[Path, Provenance | UsageError | MissingInputError]]:
    """Yield the folders of a shot's versions, in order, and their provenance or why it cannot be read."""
    folders = published_folder(root, shot).glob("v*")
    versions = (place for place in folders if re.fullmatch(VERSION, place.name))
    for place in sorted(versions, key=lambda place: (int(place.name[1:]), place.name)):
        try:
            yield place, Provenance.read(place / FILE)
        except (UsageError, MissingInputError) as error:
            yield place, error


def published_versions(root: Path, shot: str | None) -> Iterator[PublishedVersion]:
    """Yield the versions of a shot, or of all shots."""
    for name in (
        sorted(folder.name for folder in Folders.of_root(root).published.glob("*"))
        if shot is None
        else [shot]
    ):
        for folder, record in records(root, name):
            if not isinstance(record, Provenance):
                fault = str(record).removeprefix(f"{folder / FILE}: ")
                yield PublishedVersion(name, folder.name, folder / FILE, fault=fault)
                continue
            files = {folder / frame.file: frame.sha256 for frame in record.frames.values()}
            others = [each for each in (record.movie, record.notes) if each]
            yield PublishedVersion(
                shot=name,
                name=record.version,
                record=folder / FILE,
                frames={number: folder / frame.file for number, frame in record.frames.items()},
                keys={number: frame.frame for number, frame in record.frames.items()},
                files=files | {folder / each["file"]: each["sha256"] for each in others},
                notes=folder / record.notes["file"] if record.notes else None,
            )


def packages() -> dict[str, str]:
    """Return the versions of flowsculpt and of the packages that pixels come from."""
    return {"flowsculpt": version("flowsculpt"), **{name: version(name) for name in PACKAGES}}


def stage_versions() -> dict[str, int]:
    """Return the versions of the stages that a published version comes from."""
    return {name: PipelineStage.all()[name].version for name in _STAGES}


def host() -> dict[str, Any]:
    """Describe the machine of this process."""
    return {
        "name": platform.node(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "memory_mib": psutil.virtual_memory().total // 2**20,
    }


def _processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()
