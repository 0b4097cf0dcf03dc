"""Patches: a new version of a published one, some of whose frames are rendered again."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pipeline.errors import FrameError, MissingInputError, UsageError
from pipeline.frames import FrameRange
from pipeline.plugins.versions.publishing import Release
from pipeline.production.request.audio import samples_of
from pipeline.production.request.keys import FrameKeys
from pipeline.production.request.lookup import movie_bits
from pipeline.production.request.provenance import FILE, VERSION, FrameRecord, Provenance
from pipeline.production.store.paths import published
from pipeline.production.store.store import Key
from render.base.input_files import digest_of_file
from render.base.render_errors import RenderError
from render.movie.codecs import movie_encode
from render.movie.encode import write_movie
from render.movie.movie_frames import Frame
from render.post.colour import quantise, to_display
from render.post.image import read_exr


@dataclass(frozen=True)
class Patch(Release):
    """A base version with the frames of a range replaced by today's, and a movie of all."""

    base: str = ""
    frames: str = ""

    @cached_property
    def _folder(self) -> Path:
        return self.store.root / published(self.request.name) / self.base

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
        size = request.quality.width, request.quality.height
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
        whole, asked = FrameRange.of(self.request.angles), FrameRange.parse(self.frames)
        if outside := asked.outside(whole):
            raise UsageError(
                f"-f {self.frames}: frames {outside} are not in {self.request.name}, which has {whole}; name "
                "frames among those"
            )
        return frozenset(asked)

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
        frames, digest = str(FrameRange.of(self._numbers)), digest_of_file(self._folder / FILE)
        return replace(record, patch={"version": self.base, "frames": frames, "sha256": digest})

    def _frame(self, number: int, keys: Mapping[int, FrameKeys]) -> FrameRecord:
        if number in self._numbers:
            return super()._frame(number, keys)
        frame, file = self._before.frames[number], self._files()[number]
        if not file.is_file() or digest_of_file(file) != frame.sha256:
            raise FrameError(f"--patch {self.base}: {file} is damaged or missing; see flowsculpt verify")
        return frame

    def _whole_movie(self, key: Key) -> str:
        """Encode the movie unless the store has it, and return its digest."""
        request, count = self.request, len(self.request.angles)
        rate, encode = request.shot.rate, movie_encode(movie_bits(request.quality_name))

        def write(path: Path) -> None:
            sound = samples_of(request.whole().sounds, count, rate)
            projection = request.projection
            write_movie(path, self._shown(), rate.fps, encode, sound=sound, projection=projection)

        self.store.put("movie", key, write)
        return super()._whole_movie(key)

    def _shown(self) -> Iterator[Frame]:
        """Yield all frames in order, as the display of today shows them."""
        keys, files, picture = self._keys(), self._files(), self.request.shot.picture
        for number in sorted(self.request.angles):
            path = files.get(number) or self.store.path("frame", keys[number].frame)
            try:
                light = read_exr(path)[0]["beauty"]
            except RenderError as error:
                raise FrameError(f"{path}: cannot be read ({error}); run again", number) from None
            yield quantise(to_display(light, picture.lights.exposure, view=picture.view), bits=16)
