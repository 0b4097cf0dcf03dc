"""Sources of deliverables: the frames of a shot or of a film, and the facts for its slate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from pathlib import Path
from typing import Any, TypeVar

from pipeline.dailies.delivery.frame_reader import Failures, FrameFormat, FrameReader, LabelledFrame, opaque
from pipeline.errors import FrameError
from pipeline.frames import FrameRange, FrameRate
from pipeline.production.request.edit import Edit
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import paths
from pipeline.production.store.store import Store
from pipeline.production.tasks.movies import cut_together
from render.base.serialise import to_plain
from render.movie.planes import Frame
from render.movie.sequences import FILM_START, dissolve, mix_frames

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class DeliverySource:
    """Frames in order, and facts about them.

    name          of the files
    folder        of the files, relative to the root
    start         the frame number that gives the first timecode
    count         the number of frames
    facts         names and values for the slate
    content       plain data of everything that decides the frames
    lost          frames that cards stand for, shot by shot
    has_coverage  True if the subject's coverage is known in all of them
    edit          of a film; None for a shot
    frames        reads the frames in a format
    poster        reads one of them, for the slate
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
    has_coverage: bool
    edit: Edit | None
    frames: Callable[[FrameFormat], Iterator[LabelledFrame]]
    poster: Callable[[FrameFormat], LabelledFrame]


def shot_source(request: RenderRequest, store: Store, failures: Failures) -> DeliverySource:
    """Return the frames of a request, in ascending order. Raises FrameError where all failed."""
    reader, numbers = FrameReader(request, store, failures), sorted(request.requested)
    lost = _lost([(reader, n) for n in numbers])
    finished = [n for n in numbers if reader.is_finished(n)]
    frames = FrameRange.of(numbers)
    rate = FrameRate.of(request.source.summary.rate)
    key = str(reader.keys[numbers[0]].frame)[:10] if reader.keys else ""
    return DeliverySource(
        name=f"{request.folders.name}.{frames}",
        title=request.name,
        subtitle=request.shot.title,
        folder=request.folders.home / request.quality_name / "deliver",
        rate=rate,
        size=request.quality.rendered_size,
        start=numbers[0],
        count=len(numbers),
        facts=(("version", reader.version), *_facts(request, str(frames), len(numbers), rate), ("key", key)),
        content=reader.content(numbers),
        lost=lost,
        has_coverage=all(reader.has_coverage(n) for n in finished),
        edit=None,
        frames=lambda wanted: (reader.read(n, wanted) for n in numbers),
        poster=lambda wanted: reader.read(_middle(finished), wanted),
    )


def film_source(
    edit: Edit, requests: Sequence[RenderRequest], store: Store, failures: Failures
) -> DeliverySource:
    """Return the film of an edit. Raises FrameError where all frames of its shots failed."""
    readers = [FrameReader(request, store, failures) for request in requests]
    numbered = [(reader, n) for reader in readers for n in reader.request.requested]
    lost = _lost(numbered)
    finished = [(reader, n) for reader, n in numbered if reader.is_finished(n)]
    quality_name, rate = requests[0].quality_name, edit.frame_rate
    size = requests[0].quality.rendered_size
    opening = edit.items[0]

    def frames(wanted: FrameFormat) -> Iterator[LabelledFrame]:
        def clip(index: int) -> Iterator[LabelledFrame]:
            return (readers[index].read(n, wanted) for n in readers[index].request.requested)

        def card(frame: Frame) -> LabelledFrame:
            return opaque(frame, wanted), {"quality": quality_name, "shot": edit.name}

        return dissolve(list(cut_together(edit, size, clip, card)), _mix)

    poster = _middle(finished)
    shots = dict.fromkeys(f"{reader.request.name} {reader.version}" for reader in readers)
    return DeliverySource(
        name=edit.name,
        title=opening.title or edit.name,
        subtitle=opening.subtitle,
        folder=paths.film(quality_name, edit.name).parent / "deliver",
        rate=rate,
        size=size,
        start=FILM_START * ceil(rate.fps),
        count=edit.length,
        facts=(("shots", ", ".join(shots)), *_facts(requests[0], f"{edit.length}", edit.length, rate)),
        content=[to_plain(edit.items), *(reader.content(reader.request.requested) for reader in readers)],
        lost=lost,
        has_coverage=all(reader.has_coverage(n) for reader, n in finished),
        edit=edit,
        frames=frames,
        poster=lambda wanted: poster[0].read(poster[1], wanted),
    )


def _mix(before: LabelledFrame, after: LabelledFrame, weight: float) -> LabelledFrame:
    """Mix two frames; the labels are those of the one with more weight."""
    return mix_frames(before[0], after[0], weight), after[1] if weight >= 0.5 else before[1]


def _middle(values: Sequence[T]) -> T:
    return values[len(values) // 2]


def _lost(numbered: Sequence[tuple[FrameReader, int]]) -> tuple[str, ...]:
    """Name the missing frames of each shot. Raises FrameError where all are missing."""
    lost = [(reader, n) for reader, n in numbered if not reader.is_finished(n)]
    if len(lost) == len(numbered):
        reader, number = lost[0]
        raise FrameError(
            f"{reader.request.name}: none of its frames could be made, so there is nothing to deliver; the "
            f"first failed: {reader.reason(number)}"
        )
    by_shot: dict[str, list[int]] = {}
    for reader, number in lost:
        by_shot.setdefault(reader.request.name, []).append(number)
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
