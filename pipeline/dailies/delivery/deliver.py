"""Deliverables: reels encoded by name, with slates, burn-ins and sound; what is there is not made again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.dailies.delivery.reel import Reel
from pipeline.dailies.delivery.rushes import Look, Shown, opaque
from pipeline.errors import MachineError
from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import DELIVER
from pipeline.production.request.edit import AudioTrack
from pipeline.production.store.store import Store
from render.base.atomic_write import disk_errors
from render.graphics.burn_in import BurnIn
from render.graphics.slate import Slate
from render.movie.codecs import Encode
from render.movie.encode import write_movie
from render.movie.planes import Frame
from render.movie.sequences import prefetch
from render.movie.sound import Samples, blocks
from render.movie.timecode import timecode
from render.post.colour import quantise

SLATES = ("head", "apart")
"""Where a slate can be: before the first frame, or in a file of its own."""

SLATE_SECONDS = 2

_KINDS = {".mp4": "movie", ".mov": "mov", ".mkv": "mkv", ".webp": "webp"}


@dataclass(frozen=True)
class Order:
    """What is to be made of reels.

    encodes  each makes a file
    slate    one of SLATES; None for no slate
    burn_in  what is told over the frames; None for nothing
    heard    sound in the place of the film's own
    folder   where files go; by default beside the frames
    """

    encodes: tuple[Encode, ...]
    slate: str | None = None
    burn_in: BurnIn | None = None
    audio: AudioTrack | None = None
    folder: Path | None = None


@dataclass(frozen=True)
class Delivered:
    """A file that is there now, and whether it was before."""

    path: Path
    encode: str
    frames: int
    found: bool


@dataclass(frozen=True, eq=False)
class Delivery:
    """A reel, and what is to be made of it."""

    reel: Reel
    order: Order
    store: Store

    def paths(self) -> list[Path]:
        """Where its files are to lie."""
        return [path for _, path, _ in self._files()]

    def make(self, bar: Callable[[str, int], Callable[[], None]]) -> list[Delivered]:
        """Encode what is not there yet.

        bar  of a file and the number of its frames, what is to be called after each of them

        Raises MachineError where the disk refuses, BadInputError for pictures that an encode cannot hold,
        FrameError where sound was changed meanwhile.
        """
        made = []
        for encode, path, what in self._files():
            self._require_folder(path.parent)
            kind, key = _KINDS[encode.suffix], self._key(encode, what)
            count = self._slate_frames if what == "apart" else self.reel.count + self._leader
            found = self.store.holds(kind, key)
            if not found:
                self.store.put(kind, key, partial(self._write, encode, what, bar(path.name, count)))
            self.store.link(kind, key, path)
            made.append(Delivered(path, encode.name, count, found))
        return made

    def _files(self) -> Iterator[tuple[Encode, Path, str]]:
        """Each encode, where its file lies, and whether it is the reel or a slate for itself."""
        folder = self.order.folder.absolute() if self.order.folder else self.reel.folder
        for encode in self.order.encodes:
            name = f"{self.reel.name}.{encode.name}"
            yield encode, folder / f"{name}{encode.suffix}", "reel"
            if self.order.slate == "apart":
                yield encode, folder / f"{name}.slate{encode.suffix}", "apart"

    def _require_folder(self, folder: Path) -> None:
        place = self.store.root / folder
        with disk_errors(place):
            place.mkdir(parents=True, exist_ok=True)
        if not os.access(place, os.W_OK):
            raise MachineError(f"{place}: permission denied; choose another folder with -o")

    # What is in a file

    @property
    def _slate_frames(self) -> int:
        return round(SLATE_SECONDS * self.reel.rate.fps)

    @property
    def _leader(self) -> int:
        """Frames before the first of the reel."""
        return self._slate_frames if self.order.slate == "head" else 0

    @property
    def _heard(self) -> AudioTrack | None:
        return self.order.audio or (self.reel.edit.audio if self.reel.edit else None)

    def _key(self, encode: Encode, what: str) -> Key:
        """Of all that a file holds; where it lies is not in it."""
        reel, audio = self.reel, self._heard
        return key_of(
            DELIVER.recipe,
            [what, self.order.slate, list(self.order.burn_in.fields) if self.order.burn_in else None],
            {name: value for name, value in asdict(encode).items() if name != "purpose"},
            audio.content if audio and encode.container.audio_codec else None,
            [str(reel.rate), list(reel.size), reel.start, reel.count, reel.covered, reel.name],
            [reel.title, reel.subtitle, [list(fact) for fact in reel.facts]] if self.order.slate else None,
            reel.content,
        )

    def _write(self, encode: Encode, what: str, passed: Callable[[], None], path: Path) -> None:
        reel, rate = self.reel, self.reel.rate.fps
        look = Look(encode.display, encode.alpha_format is not None and reel.covered)
        frames = self._slates(encode, look) if what == "apart" else self._frames(encode, look)
        first = reel.start - (self._slate_frames if self.order.slate and what == "apart" else self._leader)
        sound = self._sound() if what == "reel" and encode.container.audio_codec else None
        write_movie(path, _told(prefetch(frames), passed), rate, encode, timecode(first, rate), sound)

    def _frames(self, encode: Encode, look: Look) -> Iterator[Frame]:
        if self._leader:
            yield from self._slates(encode, look)
        for index, shown in enumerate(self.reel.frames(look)):
            yield self._burnt_in(shown, index)

    def _burnt_in(self, shown: Shown, index: int) -> Frame:
        frame, values = shown
        if self.order.burn_in is None:
            return frame
        code = timecode(self.reel.start + index, self.reel.rate.fps)
        told = self.order.burn_in.over(frame[..., :3], {**values, "timecode": code})
        burnt: Frame = np.concatenate([told, frame[..., 3:]], axis=2) if frame.shape[2] == 4 else told
        return burnt

    def _slates(self, encode: Encode, look: Look) -> Iterator[Frame]:
        """The slate, again and again."""
        reel = self.reel
        poster = reel.poster(replace(look, covered=False))[0].astype(np.float32) / np.float32(65535)
        facts = (*reel.facts, ("made as", encode.name))
        drawn = Slate(reel.title, reel.subtitle, facts, poster).draw(reel.size)
        frame = opaque(quantise(drawn, bits=16), look)
        for _ in range(self._slate_frames):
            yield frame

    def _sound(self) -> Iterator[Samples] | None:
        """What is heard under the reel and the slate before it."""
        if self._heard is None:
            return None
        sound, rate = self._heard.sound(), self.reel.rate.fps
        later = sound.start + float(self._leader / rate)
        return blocks(replace(sound, start=later), Fraction(self.reel.count + self._leader) / rate)


def _told(frames: Iterator[Frame], passed: Callable[[], None]) -> Iterator[Frame]:
    for frame in frames:
        yield frame
        passed()


def heard_from(file: Path) -> AudioTrack:
    """Sound that a user names. Raises MissingImageError or CorruptImageError."""
    from pipeline.shot.yaml.lookup import digest_of_file
    from render.movie.sound import require_sound

    require_sound(file)
    return AudioTrack(str(file.absolute()), digest_of_file(file))


def lost_frames(deliveries: Sequence[Delivery]) -> list[str]:
    """What cards stand for, in all of them."""
    return list(dict.fromkeys(frame for each in deliveries for frame in each.reel.lost))
