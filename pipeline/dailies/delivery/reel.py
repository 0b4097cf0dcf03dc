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
from pipeline.production.request.edit import Edit
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import paths
from pipeline.production.store.store import Store
from pipeline.production.tasks.movies import cut_together
from render.base.serialise import to_plain
from render.movie.planes import Frame
from render.movie.sequences import dissolve, mix_frames
from render.movie.timecode import FILM_START

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
    edit: Edit | None
    frames: Callable[[Look], Iterator[Shown]]
    poster: Callable[[Look], Shown]


def of_shot(request: RenderRequest, store: Store, failed: Failed) -> Reel:
    """The frames that a take asks for, in ascending order. Raises FrameError where none is there."""
    rushes, numbers = Rushes(request, store, failed), sorted(request.requested)
    lost = _lost([(rushes, n) for n in numbers])
    frames = FrameRange.of(numbers)
    rate = FrameRate.of(request.source.summary.rate)
    key = str(rushes.keys[numbers[0]].frame)[:10] if rushes.keys else ""
    return Reel(
        name=f"{request.folders.name}.{frames}",
        title=request.name,
        subtitle=request.shot.title,
        folder=request.folders.home / request.quality_name / "deliver",
        rate=rate,
        size=request.quality.rendered_size,
        start=numbers[0],
        count=len(numbers),
        facts=(("version", rushes.version), *_facts(request, str(frames), len(numbers), rate), ("key", key)),
        content=rushes.content(numbers),
        lost=lost,
        covered=all(rushes.covers(n) for n in numbers if rushes.holds(n)),
        edit=None,
        frames=lambda look: (rushes.shown(n, look) for n in numbers),
        poster=lambda look: rushes.shown(_middle([n for n in numbers if rushes.holds(n)]), look),
    )


def of_film(edit: Edit, requests: Sequence[RenderRequest], store: Store, failed: Failed) -> Reel:
    """The film of an edit. Raises FrameError where none of its shots' frames is there."""
    rushes = [Rushes(request, store, failed) for request in requests]
    wanted = [(each, n) for each in rushes for n in each.request.requested]
    lost = _lost(wanted)
    quality_name, rate = requests[0].quality_name, edit.frame_rate
    size = requests[0].quality.rendered_size
    opening = edit.items[0]

    def frames(look: Look) -> Iterator[Shown]:
        def clip(place: int) -> Iterator[Shown]:
            return (rushes[place].shown(n, look) for n in rushes[place].request.requested)

        def card(frame: Frame) -> Shown:
            return opaque(frame, look), {"quality": quality_name, "shot": edit.name}

        return dissolve(list(cut_together(edit, size, clip, card)), _mixed)

    poster = _middle([(each, n) for each, n in wanted if each.holds(n)])
    shots = dict.fromkeys(f"{each.request.name} {each.version}" for each in rushes)
    return Reel(
        name=edit.name,
        title=opening.title or edit.name,
        subtitle=opening.subtitle,
        folder=paths.film(quality_name, edit.name).parent / "deliver",
        rate=rate,
        size=size,
        start=FILM_START * ceil(rate.fps),
        count=edit.length,
        facts=(("shots", ", ".join(shots)), *_facts(requests[0], f"{edit.length}", edit.length, rate)),
        content=[to_plain(edit.items), *(each.content(each.request.requested) for each in rushes)],
        lost=lost,
        covered=all(each.covers(n) for each, n in wanted if each.holds(n)),
        edit=edit,
        frames=frames,
        poster=lambda look: poster[0].shown(poster[1], look),
    )


def _mixed(before: Shown, after: Shown, share: float) -> Shown:
    """What is seen more of says what is burnt in."""
    return mix_frames(before[0], after[0], share), after[1] if share >= 0.5 else before[1]


def _middle(of: Sequence[T]) -> T:
    return of[len(of) // 2]


def _lost(wanted: Sequence[tuple[Rushes, int]]) -> tuple[str, ...]:
    lost = [(rushes, n) for rushes, n in wanted if not rushes.holds(n)]
    if len(lost) == len(wanted):
        rushes, number = lost[0]
        raise FrameError(
            f"{rushes.request.name}: none of its frames could be made, so there is nothing to deliver; the "
            f"first failed: {rushes.reason(number)}"
        )
    by_shot: dict[str, list[int]] = {}
    for rushes, number in lost:
        by_shot.setdefault(rushes.request.name, []).append(number)
    return tuple(f"{name} frames {FrameRange.of(set(numbers))}" for name, numbers in by_shot.items())


def _facts(request: RenderRequest, frames: str, count: int, rate: FrameRate) -> tuple[tuple[str, str], ...]:
    quality = request.quality
    per_second = f"{rate.fps}" if rate.fps.denominator == 1 else f"{float(rate.fps):.3f} ({rate.fps})"
    length = float(Fraction(count) / rate.fps)
    width, height = quality.rendered_size
    noise = f", denoised ({quality.denoise})" if quality.denoise != "off" else ""
    return (
        ("frames", frames if frames == str(count) else f"{frames}, {count} of them"),
        ("length", f"{length:.2f} s at {per_second} frames per second"),
        ("quality", f"{request.quality_name}, {quality.samples} samples{noise}"),
        ("size", f"{width} × {height}"),
    )
