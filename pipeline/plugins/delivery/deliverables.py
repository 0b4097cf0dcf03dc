"""Encode deliverables, with slates, burn-ins and sound. Files that are up to date are not encoded again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import MachineError
from pipeline.plugin import Plugin, plugins
from pipeline.plugins.delivery.delivery_source import DeliverySource, FrameFormat, opaque
from pipeline.production.request.audio import AudioClip, AudioTrack, samples_of
from pipeline.production.stages import DELIVER
from pipeline.production.store.store import Key, Store, key_of
from render.base.atomic_write import disk_errors
from render.graphics.cards import Screen, Slate
from render.graphics.typesetting import BurnIn
from render.movie.codecs import ENCODES, Encode, timecode
from render.movie.encode import write_movie
from render.movie.movie_frames import Frame, prefetch
from render.post.colour import quantise

SLATES = ("head", "apart")  # the places of a slate: before the first frame, or in a file of its own

SLATE_SECONDS = 2

_KINDS = {".mp4": "movie", ".mov": "mov", ".mkv": "mkv", ".webp": "webp"}


def _encode_of_plugin(plugin: Plugin, name: str, encode: Any) -> Encode:
    """Return the encode of a plug-in under its full name. Raises TypeError or ValueError for what is none."""
    if not isinstance(encode, Encode):
        raise TypeError("it is not an Encode")
    if encode.suffix not in _KINDS:
        raise ValueError(f"its files end in {encode.suffix}; they can end in {', '.join(_KINDS)}")
    return replace(encode, name=name)


DELIVERABLES: Mapping[str, Encode] = {**ENCODES, **plugins().parts("encodes", _encode_of_plugin)}
"""The encodes of deliverables by name, those of plug-ins last."""


@dataclass(frozen=True)
class DeliveryOptions:
    """Options of a delivery: the files to make of a source, one for each encode.

    slate    one of SLATES; None for no slate
    burn_in  facts over the frames; None for none
    audio    replaces the film's own sound
    folder   of the files; by default next to the frames
    """

    encodes: tuple[Encode, ...]
    slate: str | None = None
    burn_in: BurnIn | None = None
    audio: AudioTrack | None = None
    folder: Path | None = None


@dataclass(frozen=True)
class DeliveredFile:
    """A file that is there now. `reused` is true if it was there before."""

    path: Path
    encode: str
    frames: int
    reused: bool


@dataclass(frozen=True, eq=False)
class Delivery:
    """A source of frames and the files to make of it."""

    source: DeliverySource
    options: DeliveryOptions
    store: Store

    def paths(self) -> list[Path]:
        """Return the paths of its files."""
        return [path for _, path, _ in self._files()]

    def make(self, bar: Callable[[str, int], Callable[[], None]]) -> list[DeliveredFile]:
        """Encode the files that are missing or out of date; `bar` gets a file's name and number of frames.

        Raises MachineError where the disk refuses, BadInputError for pictures that an encode cannot hold,
        FrameError where sound was changed meanwhile.
        """
        made = []
        place = self.store.root / self._folder
        with disk_errors(place):
            place.mkdir(parents=True, exist_ok=True)
        if not os.access(place, os.W_OK):
            raise MachineError(f"{place}: permission denied; choose another folder with -o")
        for encode, path, part in self._files():
            kind, key = _KINDS[encode.suffix], self._key(encode, part)
            count = self._slate_frames if part == "slate" else self.source.count + self._leader
            reused = self.store.bring(kind, key)
            if not reused:
                self.store.put(kind, key, partial(self._write, encode, part, bar(path.name, count)))
            self.store.link(kind, key, path)
            made.append(DeliveredFile(path, encode.name, count, reused))
        return made

    @property
    def _folder(self) -> Path:
        return self.options.folder.absolute() if self.options.folder else self.source.folder

    def _files(self) -> Iterator[tuple[Encode, Path, str]]:
        """Yield encode, path and part (frames or slate) of each file."""
        for encode in self.options.encodes:
            yield encode, self._folder / encode.file_name(self.source.name), "frames"
            if self.options.slate == "apart":
                yield encode, self._folder / encode.file_name(self.source.name, "slate"), "slate"

    @property
    def _slate_frames(self) -> int:
        return round(SLATE_SECONDS * self.source.rate.fps)

    @property
    def _leader(self) -> int:
        """The number of frames before the first of the source."""
        return self._slate_frames if self.options.slate == "head" else 0

    @property
    def _sounds(self) -> tuple[AudioClip, ...]:
        """The sound of the movie: its own, or the sounds of the frames."""
        if self.options.audio is None:
            return self.source.sounds
        return (AudioClip((self.options.audio,), 0, self.source.count),)

    def _key(self, encode: Encode, part: str) -> Key:
        """Return the key of a file: everything but its path."""
        source, options = self.source, self.options
        facts = [list(fact) for fact in source.facts]
        return key_of(
            DELIVER.recipe,
            [part, options.slate, list(options.burn_in.fields) if options.burn_in else None],
            asdict(encode),
            *([plugins().loaded[encode.name.partition(".")[0]].version] if "." in encode.name else []),
            [clip.content for clip in self._sounds] or None if encode.container.audio_codec else None,
            [str(source.rate), list(source.size), source.start, source.count],
            [source.has_coverage, source.name],
            [source.title, source.subtitle, facts] if options.slate else None,
            source.content,
        )

    def _write(self, encode: Encode, part: str, passed: Callable[[], None], path: Path) -> None:
        source, rate = self.source, self.source.rate.fps
        form = FrameFormat(encode.display, encode.alpha_format is not None and source.has_coverage)
        frames = self._slates(encode, form) if part == "slate" else self._frames(encode, form)
        first = source.start - (self._slate_frames if part == "slate" else self._leader)
        sound = None
        if part == "frames" and encode.container.audio_codec:  # also under the slate before them
            clips = [clip.later(self._leader) for clip in self._sounds]
            sound = samples_of(clips, source.count + self._leader, source.rate)
        code, counted = timecode(first, rate), _counted(prefetch(frames), passed)
        write_movie(path, counted, rate, encode, code, sound, source.projection)

    def _frames(self, encode: Encode, form: FrameFormat) -> Iterator[Frame]:
        if self._leader:
            yield from self._slates(encode, form)
        for number, (frame, labels) in enumerate(self.source.frames(form), self.source.start):
            if self.options.burn_in is not None:
                facts = {**labels, "timecode": timecode(number, self.source.rate.fps)}
                labelled = self.options.burn_in.over(frame[..., :3], facts)
                frame = np.concatenate([labelled, frame[..., 3:]], axis=2)
            yield frame

    def _slates(self, encode: Encode, form: FrameFormat) -> Iterator[Frame]:
        """Yield the slate SLATE_SECONDS long."""
        source = self.source
        poster = source.poster(replace(form, has_coverage=False))[0].astype(np.float32) / np.float32(65535)
        facts = (*source.facts, ("made as", encode.name))
        screen = Screen(source.projection, source.size)
        drawn = screen.show(Slate(source.title, source.subtitle, facts, poster).draw(screen.size))
        frame = opaque(quantise(drawn, bits=16), form)
        for _ in range(self._slate_frames):
            yield frame


def _counted(frames: Iterator[Frame], passed: Callable[[], None]) -> Iterator[Frame]:
    """Yield the frames, and call `passed` after each."""
    for frame in frames:
        yield frame
        passed()


def audio_track(file: Path) -> AudioTrack:
    """Return a sound file as audio track. Raises MissingImageError or CorruptImageError."""
    from render.base.input_files import digest_of_file
    from render.movie.movie_sound import require_sound

    require_sound(file)
    return AudioTrack(str(file.absolute()), digest_of_file(file))


def lost_frames(deliveries: Sequence[Delivery]) -> list[str]:
    """Name the frames of all deliveries that cards stand for."""
    return list(dict.fromkeys(frame for delivery in deliveries for frame in delivery.source.lost))
