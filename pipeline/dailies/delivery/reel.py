"""What is delivered, frame by frame: a shot or a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from pathlib import Path
from typing import Any, TypeVar

from pipeline.dailies.delivery.rushes import Failed, Look, Rushes, Shown, opaque
from pipeline.errors import FrameError
from pipeline.frames import FrameRange, FrameRate
from pipeline.production.request.edit import Cut
from pipeline.production.request.render_request import Take
from pipeline.production.store import paths
from pipeline.production.store.store import Store
from pipeline.production.tasks.movies import cut_together
from render.movie.dissolve import dissolved, mixed
from render.movie.planes import Frame
from render.movie.timecode import FILM_BEGINS

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Reel:
    """Frames in order, and what is said of them.

    name      of its files
    folder    where they lie, relative to the root
    start     frame whose timecode the first frame has
    count     how many frames there are
    facts     names and values, for its slate
    content   plain data of all that its frames are made from
    lost      frames that cards stand for, shot by shot
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


def of_shot(take: Take, store: Store, failed: Failed) -> Reel:
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
        facts=(("version", rushes.version), *_facts(take, str(frames), len(numbers), rate), ("key", key)),
        content=rushes.content(numbers),
        lost=lost,
        covered=all(rushes.covers(n) for n in numbers if rushes.holds(n)),
        cut=None,
        frames=lambda look: (rushes.shown(n, look) for n in numbers),
        poster=lambda look: rushes.shown(_middle([n for n in numbers if rushes.holds(n)]), look),
    )


def of_film(cut: Cut, takes: Sequence[Take], store: Store, failed: Failed) -> Reel:
    """The film of an edit. Raises FrameError where none of its shots' frames is there."""
    rushes = [Rushes(take, store, failed) for take in takes]
    wanted = [(each, n) for each in rushes for n in each.take.requested]
    lost = _lost(wanted)
    quality_name, rate = takes[0].quality_name, cut.frame_rate
    size = takes[0].quality.rendered_size
    opening = cut.pieces[0]

    def frames(look: Look) -> Iterator[Shown]:
        def clip(place: int) -> Iterator[Shown]:
            return (rushes[place].shown(n, look) for n in rushes[place].take.requested)

        def card(frame: Frame) -> Shown:
            return opaque(frame, look), {"quality": quality_name, "shot": cut.name}

        return dissolved(list(cut_together(cut, size, clip, card)), _mixed)

    poster = _middle([(each, n) for each, n in wanted if each.holds(n)])
    shots = dict.fromkeys(f"{each.take.name} {each.version}" for each in rushes)
    return Reel(
        name=cut.name,
        title=opening.title or cut.name,
        subtitle=opening.subtitle,
        folder=paths.film(quality_name, cut.name).parent / "deliver",
        rate=rate,
        size=size,
        start=FILM_BEGINS * ceil(rate.fps),
        count=cut.length,
        facts=(("shots", ", ".join(shots)), *_facts(takes[0], f"{cut.length}", cut.length, rate)),
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
    by_shot: dict[str, list[int]] = {}
    for rushes, number in lost:
        by_shot.setdefault(rushes.take.name, []).append(number)
    return tuple(f"{name} frames {FrameRange.of(set(numbers))}" for name, numbers in by_shot.items())


def _facts(take: Take, frames: str, count: int, rate: FrameRate) -> tuple[tuple[str, str], ...]:
    quality = take.quality
    per_second = f"{rate.fps}" if rate.fps.denominator == 1 else f"{float(rate.fps):.3f} ({rate.fps})"
    length = float(Fraction(count) / rate.fps)
    width, height = quality.rendered_size
    noise = f", denoised ({quality.denoise})" if quality.denoise != "off" else ""
    return (
        ("frames", frames if frames == str(count) else f"{frames}, {count} of them"),
        ("length", f"{length:.2f} s at {per_second} frames per second"),
        ("quality", f"{take.quality_name}, {quality.samples} samples{noise}"),
        ("size", f"{width} × {height}"),
    )
