"""The provenance of a published version: what it was made from, by which environment, and when."""

from __future__ import annotations

import json
import os
import platform
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import psutil

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api.files import from_plain, machine_error, to_plain
from flowsculpt.api.frames import NOTES, PUBLISHED, CorruptFileError, FrameRange, Key, Store
from flowsculpt.api.shots import NAME, is_there
from flowsculpt.pipeline.production.request.lookup import is_quality, today_name
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.production.shot_extras import PublishedFile
from flowsculpt.pipeline.production.stages import (
    ASSEMBLE,
    FINISH,
    FRAME_CAMERA,
    RENDER,
    SIMULATE,
    SMOOTH_NORMALS,
)
from flowsculpt.pipeline.production.store.digests import ALTERED
from flowsculpt.pipeline.production.store.paths import REPEATED
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.state_files import UNUSABLE
from flowsculpt.render.mitsuba.engine import available_cores

FILE = "provenance.json"
FORMAT = 2
VERSION = r"v[0-9]{3,6}"

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
        fields["quality"] = today_name(str(fields["quality"]))
        record = from_plain(cls, fields)
        _require_whole(record)
        return record

    @classmethod
    def read(cls, path: Path) -> Provenance:
        """Raises MissingInputError where it is not there, UsageError where it is none."""
        if not is_there(path):
            raise MissingInputError(
                f"{path}: no such file; flowsculpt versions lists the published versions; each has a {FILE}"
            )
        try:
            return cls.from_data(json.loads(path.read_text(encoding="utf-8")))
        except OSError as error:
            raise MissingInputError(
                f"{path}: cannot be read ({error.strerror}); check its permissions"
            ) from None
        except (*UNUSABLE, BadInputError):
            raise UsageError(
                f"{path}: not the provenance of a published version, or cut short; use the one that "
                "flowsculpt "
                "publish wrote"
            ) from None

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
    named = re.fullmatch(NAME, record.shot) and re.fullmatch(VERSION, record.version)
    known = is_quality(record.quality) and record.source.name == record.shot
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


def published(name: str) -> Path:
    """Return the folder of a shot's published versions."""
    return PUBLISHED / name


def repeated(name: str, version: str) -> Path:
    """Return the root in which a published version is made again."""
    return REPEATED / f"{name}.{version}"


def portable(source: ShotSource) -> ShotSource:
    """Return the source with paths relative to the working folder, so that a project may be moved."""
    inputs = tuple((_within(Path(path)), digest) for path, digest in source.inputs or ())
    return replace(source, path=Path(_within(source.path)), inputs=inputs or source.inputs)


def _within(path: Path) -> str:
    plain = Path(os.path.normpath(path.absolute()))
    return (plain.relative_to(Path.cwd()) if plain.is_relative_to(Path.cwd()) else plain).as_posix()


def records(folder: Path) -> Iterator[tuple[Path, Provenance | UsageError | MissingInputError]]:
    """Yield the versions in a shot's published folder, in order; an error for one that cannot be read."""
    versions = (place for place in folder.glob("v*") if re.fullmatch(VERSION, place.name))
    for place in sorted(versions, key=lambda place: (int(place.name[1:]), place.name)):
        try:
            yield place, Provenance.read(place / FILE)
        except (UsageError, MissingInputError) as error:
            yield place, error


def packages() -> dict[str, str]:
    """Return the versions of flowsculpt and of the packages that pixels come from."""
    return {"flowsculpt": version("flowsculpt"), **{name: version(name) for name in PACKAGES}}


def stage_versions() -> dict[str, int]:
    """Return the versions of the stages that a published version comes from."""
    stages = (SIMULATE, SMOOTH_NORMALS, FRAME_CAMERA, RENDER, FINISH, ASSEMBLE)
    return {stage.name: stage.version for stage in stages}


def host() -> dict[str, Any]:
    """Describe the machine of this process."""
    return {
        "name": platform.node(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": available_cores(),
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


def version_of(root: Path, shot: str, frames: Mapping[int, Key]) -> str:
    """Return the last version of a shot that has these frames, by their keys; empty where none has."""
    for _, record in reversed(list(records(root / published(shot)))):
        if isinstance(record, Provenance):
            known = {number: frame.frame for number, frame in record.frames.items()}
            if frames.items() <= known.items():
                return record.version
    return ""


def published_files(store: Store) -> Iterator[PublishedFile]:
    """Yield the files of all versions under a root, unchecked, and each provenance that is damaged."""
    for home in sorted((store.root / PUBLISHED).glob("*")):
        for place, record in records(home):
            fault = _fault_of_provenance(store, place / FILE)
            if fault is not None:  # its digests of frames may be wrong
                yield PublishedFile(place / FILE, place, fault=fault)
            elif isinstance(record, Provenance):
                for number, frame in record.frames.items():
                    yield PublishedFile(place / frame.file, place, number, frame.sha256)
                for file in filter(None, (record.movie, record.notes)):
                    yield PublishedFile(place / file["file"], place, None, file["sha256"])
            else:
                fault = str(record).removeprefix(f"{place / FILE}: ")
                yield PublishedFile(place / FILE, place, fault=fault)


def _fault_of_provenance(store: Store, path: Path) -> str | None:
    try:
        store.digests.check(path)
    except CorruptFileError:
        return ALTERED
    except OSError as error:
        return str(machine_error(path, error, "read")).removeprefix(f"{path}: ")
    return None


def remedies(faulty: Iterable[PublishedFile], root: Path) -> Iterator[str]:
    """Yield a line for each version among faulty files that says how to make its files again."""
    for folder, files in groupby(faulty, key=lambda file: file.version):
        damaged = list(files)
        if damaged[0].path == folder / FILE:
            yield f"{folder}: only its {FILE} records what it was made from; restore that file from a backup"
            continue
        record = Provenance.read(folder / FILE)
        damaged = [file for file in damaged if file.path != folder / record.notes.get("file", "")]
        if not damaged:
            yield f"{folder}: restore its notes from a backup; the current notes are in {root / NOTES}"
            continue
        numbers = [file.number for file in damaged if file.number is not None]
        only_frames = f" -f {FrameRange.of(numbers)}" if len(numbers) == len(damaged) else ""
        yield (
            f"{folder}: flowsculpt reproduce {shlex.quote(str(folder / FILE))}{only_frames} makes it "
            f"again, in {root / repeated(record.shot, record.version)}; published files are never written to"
        )
