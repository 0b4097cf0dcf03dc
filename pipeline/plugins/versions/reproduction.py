"""Making a published version again, from its provenance alone, and looking whether it comes out the same.

It happens under a root of its own, with a store of its own: nothing is taken from today's shot or from what
was rendered before, and nothing of these is touched.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from flowsculpt import MachineError, MissingInputError, UsageError
from flowsculpt.api.commands import Project
from flowsculpt.api.files import InputFile
from flowsculpt.api.frames import Folders, FrameKeys, FrameRange, Plan, RenderRequest, ShotSource, Store
from flowsculpt.api.pictures import RenderError, read_exr
from flowsculpt.pipeline.plugins.versions.provenance import Provenance


def pixels_of(path: Path) -> str:
    """Return the SHA-256 of all values of a picture. Raises what `read_exr` raises."""
    layers, _ = read_exr(path)
    digest = hashlib.sha256()
    for name in sorted(layers.arrays):
        array = np.ascontiguousarray(layers[name], dtype="<f4")
        digest.update(f"{name}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def restored(record: Provenance, allow_code: bool) -> ShotSource:
    """Return the source of a version, to be read in the working folder.

    allow_code  whether its Python files may run: the caller decides, not the provenance

    Raises UsageError or MissingInputError where files that it reads are gone or not what they were.
    """
    gone, changed = [], []
    for place, digest in record.source.inputs or ():
        if not InputFile(Path(place)).is_there():
            if digest:  # without one, the version was made while it was not there
                gone.append(place)
        elif InputFile(Path(place)).digest() != digest:
            changed.append(place)
    of = f"{record.shot} {record.version}"
    if gone:
        raise MissingInputError(
            f"{', '.join(gone)}: missing, and {of} was made from it; restore it. Relative paths start at "
            "the working folder."
        )
    if changed:
        raise UsageError(
            f"{', '.join(changed)}: changed since {of} was made from it (its digest differs); restore the "
            "earlier file"
        )
    source = replace(record.source, path=record.source.path.absolute(), allow_code=allow_code, inputs=None)
    return source.with_inputs()


@dataclass(frozen=True)
class Comparison:
    """A frame or the movie, whether it is as published (None if not made), and the difference in words."""

    what: str
    same: bool | None
    words: str = ""


@dataclass(frozen=True)
class Reproduction:
    """A version to be made again.

    source   its provenance file
    project  where it is asked for; the reproduction has a root of its own below. Its variant, if it names
             one, replaces the one that rendered the version
    frames   a range of its frames; by default all, and the movie. Of a patch, those that it has replaced
    """

    record: Provenance
    source: Path
    project: Project
    frames: FrameRange | None = None

    @property
    def home(self) -> Path:
        """The root that it is made under."""
        return Folders.of_root(self.project.root).repeated / f"{self.record.shot}.{self.record.version}"

    @property
    def store(self) -> Store:
        return Store(self.home)

    @cached_property
    def numbers(self) -> FrameRange:
        """The frames to be compared. Raises UsageError where some are not in the version, or not its own."""
        patch = self.record.patch
        whole = FrameRange.parse(patch["frames"]) if patch else FrameRange.of(self.record.frames)
        if self.frames is None:
            return whole
        outside = self.frames.outside(whole)
        if outside and patch:
            raise UsageError(
                f"{self.source}: {self.record.version} has frames {outside} from {patch['version']}; "
                "reproduce them from the provenance of that version"
            )
        if outside:
            raise UsageError(
                f"{self.source}: frames {outside} are not in {self.record.version}, which has {whole}; ask "
                "for frames among those"
            )
        return FrameRange(dict.fromkeys(self.frames))

    @cached_property
    def notes(self) -> list[str]:
        """Notes for the user: why another variant renders, and how the environment differs."""
        notes: list[str] = []
        variant = self._variant(notes)
        return [*notes, *self.record.differences(variant)]

    @property
    def request(self) -> RenderRequest:
        """The request, with the neighbouring frames that the temporal denoiser reads.

        Raises UsageError or MissingInputError where files that the version was made from have changed.
        """
        request = RenderRequest(self._source, self.record.quality, self._variant([]), self.numbers)
        is_recorded, window = self.record.frames.__contains__, request.pictures.window
        around = {n for number in self.numbers for n in window(number, is_recorded)}
        return replace(request, requested=FrameRange(sorted(around)))

    @cached_property
    def _source(self) -> ShotSource:
        source = restored(self.record, self.project.allow_code)
        beyond = FrameRange.of(self.record.frames).outside(source.shot.frames)
        if beyond:
            raise UsageError(
                f"{self.source}: frames {beyond} are not in its own shot, so one of the two was changed; use "
                "the provenance that flowsculpt publish wrote"
            )
        return source

    def plan(self) -> Plan:
        """Return the plan. Raises what `request` raises."""
        planner, request = replace(self.project, root=self.home).planner(), self.request
        planner.pictures(request)
        if self._has_movie:
            planner.movie(request)
        return planner.plan()

    def comparisons(self) -> list[Comparison]:
        """Compare every frame, and the movie if all frames are made."""
        keys = self.request.keys.pictures(self.store)
        found = [self._frame(number, keys) for number in self.numbers]
        return [*found, self._movie()] if self._has_movie else found

    @property
    def _has_movie(self) -> bool:
        """True if the movie is made again: that of a patch is of frames from two versions."""
        return self.frames is None and not self.record.patch

    def _variant(self, notes: list[str]) -> str:
        variant = self.project.variant or self.record.variant
        try:
            again = replace(self.project, root=self.home, variant=variant, notes=notes)
            return again.variant_of(self.record.shot)
        except MachineError as error:
            reason = str(error).partition(";")[0]
            raise MachineError(
                f"{reason}; --variant renders {self.record.version} with another variant; pixels will differ"
            ) from None

    def _frame(self, number: int, keys: Mapping[int, FrameKeys] | None) -> Comparison:
        what, then = f"frame {number}", self.record.frames[number]
        try:
            if keys is None:
                raise FileNotFoundError
            file = self.store.path("frame", keys[number].frame)
            if pixels_of(file) == then.pixels:
                return Comparison(what, True)
            return Comparison(what, False, _difference(file, self.source.parent / then.file))
        except (FileNotFoundError, RenderError):
            return Comparison(what, None, "was not made")

    def _movie(self) -> Comparison:
        file = self.home / self.request.movie_path
        if not file.exists():
            return Comparison("movie", None, "was not made")
        return Comparison("movie", InputFile(file).digest() == self.record.movie["sha256"])


def _difference(file: Path, before: Path) -> str:
    """Describe how a picture differs from the published one, if that is still there."""
    try:
        now, then = (read_exr(path)[0]["beauty"] for path in (file, before))
    except RenderError:
        return ""
    if now.shape != then.shape:
        return "has another size"
    apart = np.abs(now - then).max(axis=2)
    share, most = float((apart > 0.0).mean()), float(apart.max())
    return f"differs in {share:.2%} of its pixels, by up to {most:.3g}" if most else "has different layers"
