"""What is delivered, frame by frame: a shot or a film as a display shows it, cards for what failed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import FrameError
from pipeline.frames import FrameRange, FrameRate
from pipeline.production.files import layout, readers
from pipeline.production.files.store import CorruptFileError, Store
from pipeline.production.runs.history import History
from pipeline.production.takes.edit import Cut
from pipeline.production.takes.keyring import Keyring
from pipeline.production.takes.take import Take
from pipeline.production.tasks.movies import cut_together
from pipeline.production.versions.provenance import Provenance, records
from render.colour import quantise, to_display
from render.dissolve import dissolved, mixed
from render.errors import RenderError
from render.planes import Frame
from render.slate import failure

T = TypeVar("T")

Shown = tuple[Frame, Mapping[str, str | int]]
"""A display frame, and what can be burnt in over it."""

STAGES = ("simulate", "smooth_normals", "frame_camera", "render", "finish")

IN_WORK = "in work"
"""The version of what is not published."""

HOUR = 3600
"""Seconds of timecode at which films begin: what comes before them has room to."""


@dataclass(frozen=True)
class Look:
    """How frames are asked for: the values of which display, and with coverage or without."""

    display: str
    covered: bool


@dataclass(frozen=True, eq=False)
class Reel:
    """Frames in order, and what is said of them.

    name      of its files
    folder    where they lie, relative to the root
    start     frame whose timecode the first frame has
    count     how many frames there are
    facts     names and values, for its slate
    content   plain data of all that its frames are made from
    lost      frames that cards stand for
    frames    the frames themselves
    poster    one of them, for its slate
    covered   whether the coverage of the subject is known in all of them
    """

    name: str
    title: str
    subtitle: str
    folder: Path
    rate: FrameRate
    size: tuple[int, int]
    start: int
    count: int
    facts: tuple[tuple[str, str], ...]
    content: list[Any]
    lost: tuple[str, ...]
    covered: bool
    cut: Cut | None
    frames: Callable[[Look], Iterator[Shown]]
    poster: Callable[[Look], Shown]


class Rushes:
    """The finished frames of a take, those that are there."""

    def __init__(self, take: Take, store: Store, failed: Mapping[tuple[str, int], str]) -> None:
        self.take, self._store = take, store
        self.keys: Keyring | None = take.picture_keys(store)
        self.version = _version(take, store, self.keys)
        history = History.of(store.root).failed(take.folders.name, STAGES, take.quality_name)
        self._reasons = {**history, **{n: why for (shot, n), why in failed.items() if shot == take.subject}}

    def holds(self, number: int) -> bool:
        return self.keys is not None and self._store.holds("frame", self.keys[number].frame)

    def covers(self, number: int) -> bool:
        """Whether how much of each pixel the subject covers is there too."""
        return self.keys is not None and self._store.holds("raw", self.keys[number].raw)

    def content(self, numbers: Sequence[int]) -> list[Any]:
        """Plain data of what is shown, cards and all."""
        shown = [self._key(n) if self.holds(n) else [n, self.reason(n)] for n in numbers]
        return [self.take.name, self.version, list(numbers), shown, dict(self.take.shown_as)]

    def reason(self, number: int) -> str:
        told = self._reasons.get(number, "it was not made")
        return told.removeprefix(f"frame {number}: ")

    def shown(self, number: int, look: Look) -> Shown:
        """A frame as a display shows it, or the card in its place."""
        if not self.holds(number):
            return self._card(number, self.reason(number), look), self._values(number, "")
        try:
            return self._picture(number, look), self._values(number, self._key(number))
        except (RenderError, CorruptFileError) as error:
            return self._card(number, f"{error}", look), self._values(number, "")

    def _picture(self, number: int, look: Look) -> Frame:
        take, picture = self.take, self.take.shot.picture
        light = self._layer("frame", self._key(number), "beauty")
        values = to_display(light, picture.lights.exposure, look.display, picture.view)
        frame: Frame = quantise(values, bits=16)
        if not look.covered:
            return frame
        assert self.keys is not None, "a frame that is there has a key"
        cover = self._layer("raw", self.keys[number].raw, "matte").reshape(*frame.shape[:2], 1)
        assert frame.shape[:2][::-1] == take.quality.rendered_size
        return np.concatenate([frame, np.rint(cover.clip(0.0, 1.0) * 65535).astype(np.uint16)], axis=2)

    def _layer(self, kind: str, key: str, layer: str) -> NDArray[np.float32]:
        read = readers.picture(key, self.take.quality.rendered_size)
        return read(self._store.path(kind, key))[0][layer]

    def _card(self, number: int, reason: str, look: Look) -> Frame:
        size = self.take.quality.rendered_size
        heading = f"{self.take.name}  frame {number} failed"
        return opaque(quantise(failure(size, heading, reason), bits=16), look)

    def _key(self, number: int) -> str:
        return self.keys[number].frame if self.keys is not None else ""

    def _values(self, number: int, key: str) -> Mapping[str, str | int]:
        name, quality = self.take.name, self.take.quality_name
        return {"shot": name, "version": self.version, "frame": number, "key": key[:10], "quality": quality}


def opaque(frame: NDArray[Any], look: Look) -> Frame:
    """A frame (H, W, 3) as it is asked for: covered everywhere, where coverage is."""
    full = np.full((*frame.shape[:2], 1), np.iinfo(frame.dtype).max, dtype=frame.dtype)
    made: Frame = np.concatenate([frame, full], axis=2) if look.covered else frame
    return made


def of_shot(take: Take, store: Store, failed: Mapping[tuple[str, int], str]) -> Reel:
    """The frames that a take asks for, in ascending order. Raises FrameError where none is there."""
    rushes, numbers = Rushes(take, store, failed), sorted(take.requested)
    lost = _lost([(rushes, n) for n in numbers])
    frames = FrameRange.of(numbers)
    rate = FrameRate.of(take.script.outline.rate)
    key = str(rushes.keys[numbers[0]].frame)[:10] if rushes.keys else ""
    return Reel(
        name=f"{take.folders.name}.{frames}",
        title=take.name,
        subtitle=take.shot.title,
        folder=take.folders.home / take.quality_name / "deliver",
        rate=rate,
        size=take.quality.rendered_size,
        start=numbers[0],
        count=len(numbers),
        facts=_facts(rushes, str(frames), len(numbers), rate, key),
        content=rushes.content(numbers),
        lost=lost,
        covered=all(rushes.covers(n) for n in numbers if rushes.holds(n)),
        cut=None,
        frames=lambda look: (rushes.shown(n, look) for n in numbers),
        poster=lambda look: rushes.shown(_middle([n for n in numbers if rushes.holds(n)]), look),
    )


def of_film(cut: Cut, takes: Sequence[Take], store: Store, failed: Mapping[tuple[str, int], str]) -> Reel:
    """The film of an edit. Raises FrameError where none of its shots' frames is there."""
    rushes = [Rushes(take, store, failed) for take in takes]
    wanted = [(each, n) for each in rushes for n in each.take.requested]
    lost = _lost(wanted)
    quality_name, rate = takes[0].quality_name, cut.frame_rate
    size = takes[0].quality.rendered_size
    title = next((piece.title for piece in cut.pieces if piece.title), cut.name)

    def frames(look: Look) -> Iterator[Shown]:
        def clip(place: int) -> Iterator[Shown]:
            return (rushes[place].shown(n, look) for n in rushes[place].take.requested)

        def card(frame: Frame) -> Shown:
            return opaque(frame, look), {"quality": quality_name, "shot": cut.name}

        return dissolved(list(cut_together(cut, size, clip, card)), _mixed)

    poster = _middle([(each, n) for each, n in wanted if each.holds(n)])
    shots = f"{len({take.name for take in takes})} shots"
    return Reel(
        name=cut.name,
        title=title,
        subtitle=shots,
        folder=layout.film(quality_name, cut.name).parent / "deliver",
        rate=rate,
        size=size,
        start=HOUR * ceil(rate.fps),
        count=cut.length,
        facts=_facts(rushes[0], f"{cut.length}", cut.length, rate, ""),
        content=[cut.as_data()["pieces"], *(each.content(each.take.requested) for each in rushes)],
        lost=lost,
        covered=all(each.covers(n) for each, n in wanted if each.holds(n)),
        cut=cut,
        frames=frames,
        poster=lambda look: poster[0].shown(poster[1], look),
    )


def _mixed(before: Shown, after: Shown, share: float) -> Shown:
    """What is seen more of says what is burnt in."""
    return mixed(before[0], after[0], share), after[1] if share >= 0.5 else before[1]


def _middle(of: Sequence[T]) -> T:
    return of[len(of) // 2]


def _lost(wanted: Sequence[tuple[Rushes, int]]) -> tuple[str, ...]:
    lost = [(rushes, n) for rushes, n in wanted if not rushes.holds(n)]
    if len(lost) == len(wanted):
        rushes, number = lost[0]
        raise FrameError(
            f"{rushes.take.name}: none of its frames could be made, so there is nothing to deliver; the "
            f"first failed: {rushes.reason(number)}"
        )
    return tuple(f"{rushes.take.name} frame {n}" for rushes, n in lost)


def _facts(rushes: Rushes, frames: str, count: int, rate: FrameRate, key: str) -> tuple[tuple[str, str], ...]:
    take = rushes.take
    quality = take.quality
    per_second = f"{rate.fps}" if rate.fps.denominator == 1 else f"{float(rate.fps):.3f} ({rate.fps})"
    length = float(Fraction(count) / rate.fps)
    width, height = quality.rendered_size
    noise = f", denoised ({quality.denoise})" if quality.denoise != "off" else ""
    return (
        ("version", rushes.version),
        ("frames", f"{frames}, {count} of them" if frames != str(count) else frames),
        ("length", f"{length:.2f} s at {per_second} frames per second"),
        ("quality", f"{take.quality_name}, {quality.samples} samples{noise}"),
        ("size", f"{width} × {height}"),
        *((("key", key),) if key else ()),
    )


def _version(take: Take, store: Store, keys: Keyring | None) -> str:
    """The published version whose frames these are."""
    if keys is None or take.turntable is not None:
        return IN_WORK
    ours = {n: keys[n].frame for n in take.requested}
    for _, record in reversed(list(records(store.root / layout.published(take.name)))):
        if (
            isinstance(record, Provenance)
            and ours.items() <= {n: frame.frame for n, frame in record.frames.items()}.items()
        ):
            return record.version
    return IN_WORK
