"""Publishing: the frames and the movie of a shot, frozen as a version that nothing overwrites.

They stay whatever becomes of the shot, its renders and the store. The folder of a version is laid whole or
not at all, and read-only; frames are links to files of the store, or copies of them.

renders/published/<shot>/v001/frames/<shot>.0001.exr
renders/published/<shot>/v001/<shot>.mp4
renders/published/<shot>/v001/notes.json          where the shot has notes
renders/published/<shot>/v001/provenance.json

A patch is a new version of a published one, some of whose frames are rendered again.
"""

from __future__ import annotations

import contextlib
import getpass
import hashlib
import json
import os
import re
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flowsculpt import FlowsculptError, FrameError, MissingInputError, UsageError
from flowsculpt.api import ShotExtras
from flowsculpt.api.files import InputFile, atomic_folder, remove_tree
from flowsculpt.api.frames import (
    FrameKeys,
    FrameRange,
    Locks,
    PictureSequence,
    PipelineStage,
    RenderRequest,
    Runs,
    SequenceQuery,
    Store,
    StoredFiles,
)
from flowsculpt.api.pictures import AudioClip, RenderError, loop_frames, read_exr, write_movie
from flowsculpt.pipeline.plugins.versions.provenance import (
    FILE,
    VERSION,
    FrameRecord,
    Provenance,
    host,
    packages,
    portable,
    published_folder,
    records,
    stage_versions,
)
from flowsculpt.pipeline.plugins.versions.reproduction import pixels_of, restored

_DRAFT = ".draft."

NOTES = "notes.json"  # the file of notes in the folder of a version


def freeze(
    store: Store,
    record: Provenance,
    final: Path,
    copy: bool = False,
    notes: bytes = b"",
    files: Mapping[int, Path] | None = None,
) -> None:
    """Lay the frames and the movie of a version at `final`, with its provenance and notes.

    Frames are links to the files of the store, which take no space, or to `files` by number. They are copies
    where links fail, and with `copy`. The movie is a copy. All files are read-only. Raises MachineError where
    the disk refuses; then nothing is left of it.
    """
    freeze_frame = _copy if copy else _link
    with atomic_folder(final, f"{_DRAFT}{final.name}.") as draft:
        for number, frame in record.frames.items():
            source = (files or {}).get(number) or store.path("frame", frame.frame)
            freeze_frame(source, draft / frame.file)
            store.digests.add_copy(final / frame.file, source)
        _copy(store.path("movie", record.movie["key"]), draft / record.movie["file"])
        text = json.dumps(record.as_data(), indent=1, ensure_ascii=False) + "\n"
        for name, content in ((NOTES, notes), (FILE, text.encode())):
            if content:
                (draft / name).write_bytes(content)
                _settle(draft / name)
        store.digests.add(final / FILE, draft / FILE)


def sweep(home: Path) -> None:
    """Remove drafts of killed processes. Only the holder of the lock may call this."""
    for draft in home.glob(f"{_DRAFT}*"):
        remove_tree(draft)


def _link(source: Path, place: Path) -> None:
    """Link a file, which is read-only as the store's is."""
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, place)
    except OSError:
        _copy(source, place)


def _copy(source: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, place)
    _settle(place)


def _settle(place: Path) -> None:
    """Make a file read-only and flush it to the disk."""
    place.chmod(0o444)
    with place.open("rb") as file:
        os.fsync(file.fileno())


@dataclass(frozen=True)
class Published:
    """A published version, its folder, and whether it was published before."""

    version: str
    folder: Path
    before: bool


@dataclass(frozen=True)
class Release:
    """A request to be published.

    command  the command that renders it, for messages
    version  by default the next
    copy     copy its frames instead of linking to the store's, so that damage reaches only one
    """

    request: RenderRequest
    store: Store
    command: str
    note: str = ""
    version: str | None = None
    copy: bool = False

    def publish(self, dry: bool = False) -> Published:
        """Freeze the frames and the movie, or name the version with the same content; `dry` changes nothing.

        Raises MissingInputError where frames are missing, UsageError where they are stale or the version is
        taken, FrameError where one is damaged, MachineError where another run is at work or the disk refuses.
        """
        if dry:
            return self._published(dry=True)
        request, root = self.request, self.store.root
        names = {
            f"published.{request.name}": f"a version of {request.name}",
            Locks.name(request.name, request.quality_name): f"{request.name} at {request.quality_name}",
        }
        with Locks(root).hold_with_writers(), Locks(root).hold(names):
            sweep(self._home)
            return self._published(dry=False)

    @property
    def _home(self) -> Path:
        return published_folder(self.store.root, self.request.name)

    def _published(self, dry: bool) -> Published:
        keys = self._keys()
        known = list(records(self.store.root, self.request.name))
        content = (*(keys[n].frame for n in sorted(self.request.angles)), self._movie_key(keys))
        for place, record in known:
            if isinstance(record, Provenance) and record.content == content:
                return Published(record.version, place, before=True)
        version = self._version([place.name for place, _ in known])
        final = self._home / version
        if not dry:
            extras = ShotExtras.of_plugins().values()
            files = (each.notes(self.store.root, self.request.name) for each in extras)
            notes = next(filter(None, files), b"")
            record = self._record(version, keys, notes)
            freeze(self.store, record, final, self.copy, notes, self._files())
        return Published(version, final, before=False)

    def _version(self, taken: list[str]) -> str:
        """Return the version asked for, or the one after the last."""
        after = f"v{max((int(name[1:]) for name in taken), default=0) + 1:03d}"
        if self.version is None:
            return after
        if not re.fullmatch(VERSION, self.version):
            raise UsageError(f"--version {self.version} is not a version; write {after}, or leave it out")
        if int(self.version[1:]) in (int(name[1:]) for name in taken):
            raise UsageError(
                f"--version {self.version}: {self.request.name} {self.version} is already published with "
                f"other frames, and published files are never overwritten; the next is {after}"
            )
        return self.version

    def _keys(self) -> Mapping[int, FrameKeys]:
        """Return the keys of its frames. Raises MissingInputError or UsageError if some are not current."""
        request, store = self.request, self.store
        keys = self._rendered(request.angles)
        if not store.shows("movie", self._movie_key(keys), request.movie_path):
            name, there = request.movie_path.name, (store.root / request.movie_path).exists()
            self._require("" if there else name, name if there else "")
        return keys

    def _files(self) -> Mapping[int, Path]:
        """Return the files of frames that the store need not have."""
        return {}

    def _rendered(self, numbers: Collection[int]) -> Mapping[int, FrameKeys]:
        """Return keys of frames. Raises MissingInputError or UsageError if some of these are not current."""
        request, store = self.request, self.store
        keys = request.keys.pictures(store, numbers)
        missing: list[int] = []
        stale: list[int] = []
        for number in numbers:
            place = request.place("frame", number)
            if not store.shows("frame", keys[number].frame if keys else None, place):
                (stale if (store.root / place).exists() else missing).append(number)
        self._require(*(_listed(numbers) if numbers else "" for numbers in (missing, stale)))
        assert keys is not None, "frames that are shown have keys"
        return keys

    def _movie_key(self, keys: Mapping[int, FrameKeys]) -> str:
        return self.request.whole().keys.movie([keys[n].frame for n in sorted(self.request.angles)])

    def _require(self, missing: str, stale: str) -> None:
        """Raise MissingInputError or UsageError if a file is missing or stale."""
        facts = [f"{missing} missing"] if missing else []
        facts += [f"{stale} stale: made from an earlier shot file or with --set"] if stale else []
        if facts:
            kind = MissingInputError if missing else UsageError
            raise kind(
                f"{self.request.name} at {self.request.quality_name}: {'; '.join(facts)}. Publishing needs "
                f"frames of the current shot file; {self.command} makes it."
            )

    def _record(self, version: str, keys: Mapping[int, FrameKeys], notes: bytes) -> Provenance:
        request, root, movie = self.request, self.store.root, self._movie_key(keys)
        return Provenance(
            shot=request.name,
            version=version,
            title=request.shot.title,
            note=self.note,
            published=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            user=_user(),
            quality=request.quality_name,
            size=(request.pictures.quality.width, request.pictures.quality.height),
            rate=str(request.shot.motion.rate),
            variant=request.variant,
            source=portable(replace(request.source, allow_code=False)),
            cameras=request.keys.cameras,
            frames={number: self._frame(number, keys) for number in sorted(request.angles)},
            movie={"file": f"{request.name}.mp4", "key": movie, "sha256": self._whole_movie(movie)},
            packages=packages(),
            stages=stage_versions(),
            host=host(),
            timings=_total_seconds(request, root, {n: keys[n].raw for n in request.angles}),
            notes={"file": NOTES, "sha256": hashlib.sha256(notes).hexdigest()} if notes else {},
        )

    def _frame(self, number: int, keys: Mapping[int, FrameKeys]) -> FrameRecord:
        request, found = self.request, keys[number]
        file, mesh = self.store.path("frame", found.frame), request.angles[number].mesh
        try:
            self.store.bring("frame", found.frame)
            self.store.digests.check(file)
            pixels = pixels_of(file)
        except StoredFiles.DAMAGED:
            raise self._evicted("frame", found.frame, f"frame {number}") from None
        return FrameRecord(
            file=f"frames/{request.name}.{number:04d}.exr",
            mesh=request.keys.mesh(mesh),
            normals=request.keys.normals(mesh),
            raw=found.raw,
            frame=found.frame,
            seed=request.seed(number),
            pixels=pixels,
            sha256=InputFile(file).digest(),
            seconds=_seconds_of_render(request, self.store.root, number, found.raw),
        )

    def _whole_movie(self, key: str) -> str:
        """Return the digest of the movie. Raises FrameError if it cannot be decoded to its end."""
        file = self.store.path("movie", key)
        try:
            self.store.bring("movie", key)
            self.store.digests.check(file)
            whole = StoredFiles("movie").reader(key)(file).frames == len(self.request.angles)
        except StoredFiles.DAMAGED:
            whole = False
        if not whole:
            raise self._evicted("movie", key, self.request.movie_path.name)
        return InputFile(file).digest()

    def _evicted(self, kind: str, key: str, what: str) -> FrameError:
        """Evict a damaged file, so that the next run makes it again, and return the error."""
        self.store.discard(kind, key)
        return FrameError(
            f"{self.request.name} at {self.request.quality_name}: {what} is damaged and was "
            f"evicted; {self.command} makes it again"
        )


def _user() -> str:
    with contextlib.suppress(OSError, KeyError, ImportError):
        return getpass.getuser()
    return ""


def _listed(numbers: list[int]) -> str:
    """Return `frame 1` or `frames 1-4`."""
    return f"frame{'s' if len(numbers) > 1 else ''} {FrameRange.of(numbers)}"


def published_sequences(query: SequenceQuery) -> Iterator[PictureSequence]:
    """Yield the frames of every published version of a shot."""
    name = query.path.stem
    for place, record in records(query.project.root, name):
        if isinstance(record, Provenance) and query.includes(record.quality):
            files = {number: place / frame.file for number, frame in record.frames.items()}
            patch = "patch of {version}: frames {frames} are new" if record.patch else ""
            sequence = PictureSequence(
                shot=name,
                kind="version",
                label=f"{record.version} {record.quality}",
                quality=record.quality,
                subject=name,
                numbers=tuple(sorted(record.frames)),
                files={number: path for number, path in files.items() if path.is_file()},
                faults={},
                seconds={number: frame.seconds for number, frame in record.frames.items()},
                note="; ".join(filter(None, (record.note, patch.format(**record.patch)))),
                source=record.source,
            )
            with contextlib.suppress(FlowsculptError):
                picture = restored(record, query.project.allow_code).shot.picture
                sequence = replace(sequence, display=picture.display)
            yield sequence


def _seconds_of_render(request: RenderRequest, root: Path, number: int, raw: str) -> dict[str, float]:
    """Return the seconds of one render, in parts; empty where the picture of this key has none."""
    statistics = Runs(root).statistics(request.place("statistics", number))
    return dict(statistics.seconds) if statistics is not None and statistics.key == raw else {}


def _total_seconds(request: RenderRequest, root: Path, raws: Mapping[int, str]) -> dict[str, float]:
    """Return the seconds of all frames of a request by stage; `raws` are the keys of its renders."""
    shared = sorted(name for name, stage in PipelineStage.all().items() if not stage.per_quality)
    stages = (*shared, "finish", "assemble")
    latest = Runs(root).stage_seconds(request.folders.title, request.name, request.quality_name, stages)
    renders = [sum(_seconds_of_render(request, root, number, raw).values()) for number, raw in raws.items()]
    totals = {stage: round(sum(frames.values()), 3) for stage, frames in latest.items()}
    return {**totals, "render": round(sum(renders), 3)}


@dataclass(frozen=True)
class Patch(Release):
    """A base version with the frames of a range replaced by today's, and a movie of all."""

    base: str = ""
    frames: FrameRange = field(default_factory=FrameRange)

    @cached_property
    def _folder(self) -> Path:
        return published_folder(self.store.root, self.request.name) / self.base

    @cached_property
    def _before(self) -> Provenance:
        """The earlier version. Raises MissingInputError where there is none, UsageError where it differs."""
        name, home = self.request.name, self._folder.parent
        if not re.fullmatch(VERSION, self.base):
            raise UsageError(f"--patch {self.base} is not a version; write it as v001")
        if not self._folder.is_dir():
            known = ", ".join(sorted(folder.name for folder in home.glob("v*"))) or "nothing"
            raise MissingInputError(f"--patch {self.base}: {name} has no such version; published: {known}")
        record, request = Provenance.read(self._folder / FILE), self.request
        size = request.pictures.quality.width, request.pictures.quality.height
        facts = (
            ("quality", record.quality, request.quality_name),
            ("size", "{}×{}".format(*record.size), "{}×{}".format(*size)),
            ("rate", record.rate, request.manifest.rate),
            ("frames", str(FrameRange.of(record.frames)), str(FrameRange.of(request.angles))),
            ("variant", record.variant, request.variant),
        )
        for fact, then, now in facts:
            if then != now:
                raise UsageError(
                    f"--patch {self.base}: {name} {self.base} has {fact} {then}, and today's frames {now}; "
                    "all frames of a version must match. Publish all of today's frames instead"
                )
        return record

    @cached_property
    def _numbers(self) -> frozenset[int]:
        """The frames of today. Raises UsageError where some are not in the shot."""
        whole = FrameRange(self.request.angles)
        if outside := self.frames.outside(whole):
            raise UsageError(
                f"-f {self.frames}: frames {outside} are not in {self.request.name}, which has {whole}; name "
                "frames among those"
            )
        return frozenset(self.frames)

    def _keys(self) -> Mapping[int, FrameKeys]:
        """Return the keys of the new version's frames; those of the range must be rendered."""
        before, numbers = self._before.frames, self._numbers
        found = self._rendered(sorted(numbers))
        kept = {n: FrameKeys(before[n].raw, before[n].frame, (n,)) for n in before}
        return {**kept, **{n: found[n] for n in numbers}}

    def _files(self) -> Mapping[int, Path]:
        """Return the files of the frames that the earlier version has."""
        frames = self._before.frames
        return {n: self._folder / frames[n].file for n in frames if n not in self._numbers}

    def _record(self, version: str, keys: Mapping[int, FrameKeys], notes: bytes) -> Provenance:
        record = super()._record(version, keys, notes)
        frames, digest = str(FrameRange.of(self._numbers)), InputFile(self._folder / FILE).digest()
        return replace(record, patch={"version": self.base, "frames": frames, "sha256": digest})

    def _frame(self, number: int, keys: Mapping[int, FrameKeys]) -> FrameRecord:
        if number in self._numbers:
            return super()._frame(number, keys)
        frame, file = self._before.frames[number], self._files()[number]
        if not file.is_file() or InputFile(file).digest() != frame.sha256:
            raise FrameError(f"--patch {self.base}: {file} is damaged or missing; see flowsculpt verify")
        return frame

    def _whole_movie(self, key: str) -> str:
        """Encode the movie unless the store has it, and return its digest."""
        request, numbers = self.request.whole(), sorted(self.request.angles)
        rate, encode = request.shot.rate, request.pictures.movie_encode

        def write(path: Path) -> None:
            frames = loop_frames(numbers, request.loop_dissolve, self._shown)
            sound = AudioClip.mix(request.sounds, len(numbers) - request.loop_dissolve, rate)
            options: Any = {"projection": request.pictures.projection, "loops": request.loop is not None}
            write_movie(path, frames, rate.fps, encode, sound=sound, **options)

        self.store.put("movie", key, write)
        return super()._whole_movie(key)

    def _shown(self, numbers: list[int]) -> Iterator[NDArray[Any]]:
        """Yield frames as the display of today shows them."""
        keys, files, display = self._keys(), self._files(), self.request.shot.picture.display
        for number in numbers:
            path = files.get(number) or self.store.path("frame", keys[number].frame)
            try:
                light = read_exr(path)[0]["beauty"]
            except RenderError as error:
                raise FrameError(f"{path}: cannot be read ({error}); run again", number) from None
            yield display.pixels(light)
