"""Deliverables: encoded frames of a shot or of a film, with slates, burn-ins and sound.

Frames are read as display values; cards stand for those that failed. Files that are up to date are not
encoded again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import FrameError, MachineError
from flowsculpt.api import ShotExtras, plugins, plural
from flowsculpt.api.files import make_folder, to_plain
from flowsculpt.api.frames import (
    Edit,
    FrameKeys,
    FrameRange,
    FrameRate,
    PipelineStage,
    RenderRequest,
    Runs,
    Store,
    StoredFiles,
    key_of,
)
from flowsculpt.api.pictures import (
    HDR_DISPLAYS,
    AudioClip,
    BurnIn,
    Encode,
    loop_frames,
    mix_frames,
    prefetch,
    write_movie,
)
from flowsculpt.pipeline.plugins.delivery.delivered_names import FILM_START, NAME_ENDS
from flowsculpt.pipeline.plugins.delivery.encodes import KINDS
from flowsculpt.pipeline.plugins.delivery.gain_map import is_gain_map, write_gain_map
from flowsculpt.pipeline.plugins.delivery.gif import GIF, write_gif
from flowsculpt.pipeline.plugins.delivery.hdr_frames import Frame, content_light, hdr_graphics
from flowsculpt.pipeline.plugins.delivery.png_still import PNG, write_png
from flowsculpt.pipeline.plugins.delivery.relighting import relit_version
from flowsculpt.pipeline.plugins.delivery.slate import Slate, failure_card

DELIVER = PipelineStage(
    "deliver", version=2, packages=("av", "OpenImageIO"), doing="encoding deliverables", makes="movie"
)

LabelledFrame = tuple[Frame, Mapping[str, str | int]]
"""A display frame, and the values that can be burnt in."""

Failures = Mapping[tuple[str, int], str]  # messages of the last run by name of a shot and frame number

STAGES = ("simulate", "smooth_normals", "frame_camera", "render", "finish")

IN_WORK = "in work"  # the version of frames that are not published


@dataclass(frozen=True)
class FrameFormat:
    """The display that frames are converted for, and whether they have coverage as fourth channel."""

    display: str
    has_coverage: bool


class FrameReader:
    """Reader of the finished frames of a request, or of a relit version of them by its name."""

    def __init__(
        self, request: RenderRequest, store: Store, failures: Failures, relit: str | None = None
    ) -> None:
        self.request, self._store = request, store
        self._relit = None if relit is None else relit_version(request, store, relit)
        self.keys: Mapping[int, FrameKeys] | None = request.keys.pictures(store)
        self.version = f"relit {relit}" if relit else _version(request, store, self.keys)
        history = Runs(store.root).history().failed(request.folders.name, STAGES, request.quality_name)
        latest = {n: message for (shot, n), message in failures.items() if shot == request.folders.title}
        self._reasons = {**history, **latest}

    def is_finished(self, number: int) -> bool:
        """Tell whether the frame is in the store."""
        if self._relit is not None:
            return self._relit.is_mixed(number)
        return self.keys is not None and self._store.holds("frame", self.keys[number].frame)

    def has_coverage(self, number: int) -> bool:
        """Tell whether the rendered frame, which has the subject's coverage, is in the store."""
        return self.keys is not None and self._store.holds("raw", self.keys[number].raw)

    def content(self, numbers: Sequence[int]) -> list[Any]:
        """Return plain data of everything that frames and cards show."""
        frames = [self._key(n) if self.is_finished(n) else [n, self.reason(n)] for n in numbers]
        request = self.request
        facts = [request.name, request.quality_name, self.version]
        return [*facts, list(numbers), frames, dict(request.manifest.shown_as)]

    def reason(self, number: int) -> str:
        """Return why a frame is missing: its own failure, or that of a frame before it."""
        if number in self._reasons:
            return self._reasons[number].removeprefix(f"frame {number}: ")
        if not self._reasons:
            return "it was not made"
        first = min(self._reasons)
        return f"not made, as frame {first} failed: {self.reason(first)}"

    def read(self, number: int, form: FrameFormat) -> LabelledFrame:
        """Read a frame, or draw the card that stands for it.

        A damaged frame raises FrameError and leaves the store, so that the next run makes it again.
        """
        if not self.is_finished(number):
            heading = f"{self.request.name}  frame {number} failed"
            screen = self.request.pictures.screen
            card = screen.frame(failure_card(screen.size, heading, self.reason(number)))
            return opaque(card, form), self._labels(number, "")
        return self._picture(number, form), self._labels(number, self._key(number))

    def _picture(self, number: int, form: FrameFormat) -> Frame:
        place = self._relit.place(number) if self._relit else self.request.place("frame", number)
        light = self._layer("frame", place, self._key(number), "beauty")
        frame: Frame = self.request.shot.picture.display.pixels(light, form.display)
        if not form.has_coverage:
            return frame
        assert self.keys is not None, "a finished frame has a key"
        place = self.request.place("raw", number)
        coverage = self._layer("raw", place, self.keys[number].raw, "matte").reshape(*frame.shape[:2], 1)
        return np.concatenate([frame, np.rint(coverage.clip(0.0, 1.0) * 65535).astype(np.uint16)], axis=2)

    def _layer(self, kind: str, place: Path, key: str, layer: str) -> NDArray[np.float32]:
        read = StoredFiles(kind).reader(key, size=self.request.pictures.quality.rendered_size)
        pixels: NDArray[np.float32] = self._store.read(kind, key, place, read)[0][layer]
        return pixels

    def _key(self, number: int) -> str:
        if self._relit is not None:
            return self._relit.key(number)
        return self.keys[number].frame if self.keys is not None else ""

    def _labels(self, number: int, key: str) -> Mapping[str, str | int]:
        facts = {"shot": self.request.name, "version": self.version, "quality": self.request.quality_name}
        return {**facts, "frame": number, "key": key[:10]}


def opaque(frame: NDArray[Any], form: FrameFormat) -> Frame:
    """Return a drawn frame (H, W, 3) in a format: with full coverage if the format has coverage."""
    if form.display in HDR_DISPLAYS:
        frame = hdr_graphics(frame, form.display)
    if not form.has_coverage:
        return frame
    full = np.full((*frame.shape[:2], 1), np.iinfo(frame.dtype).max, dtype=frame.dtype)
    return np.concatenate([frame, full], axis=2)


def _version(request: RenderRequest, store: Store, keys: Mapping[int, FrameKeys] | None) -> str:
    """Return the published version that has exactly these frames, or IN_WORK."""
    if keys is None:
        return IN_WORK
    ours = {n: keys[n].frame for n in request.requested}
    for extras in ShotExtras.of_plugins().values():
        for version in reversed(list(extras.versions(store.root, request.name))):
            if ours.items() <= version.keys.items():
                return version.name
    return IN_WORK


@dataclass(frozen=True, eq=False)
class DeliverySource:
    """Frames in order, and facts about them.

    folder        of the files, relative to the root
    request       of the frames, or of the first shot, which has the projection and size of all
    start         the frame number that gives the first timecode
    facts         names and values for the slate
    content       plain data of everything that decides the frames
    lost          frames that cards stand for, shot by shot
    has_coverage  True if the subject's coverage is known in all of them
    frames        reads the frames in a format
    poster        reads one of them, for the slate
    loops         True if the first frame follows the last
    """

    name: str
    title: str
    subtitle: str
    folder: Path
    rate: FrameRate
    request: RenderRequest
    start: int
    count: int
    facts: tuple[tuple[str, str], ...]
    content: list[Any]
    lost: tuple[str, ...]
    has_coverage: bool
    sounds: tuple[AudioClip, ...]
    frames: Callable[[FrameFormat], Iterator[LabelledFrame]]
    poster: Callable[[FrameFormat], LabelledFrame]
    loops: bool = False


def shot_source(
    request: RenderRequest, store: Store, failures: Failures, relit: str | None = None
) -> DeliverySource:
    """Return the frames of a request, or of a relit version by its name, in ascending order.

    Raises FrameError where all failed.
    """
    reader, numbers = FrameReader(request, store, failures, relit), sorted(request.requested)
    lost = _lost([(reader, n) for n in numbers])
    finished = [n for n in numbers if reader.is_finished(n)]
    frames = FrameRange.of(numbers)
    rate = FrameRate.of(request.manifest.rate)
    key = str(reader.keys[numbers[0]].frame)[:10] if reader.keys else ""
    return DeliverySource(
        name=_name(request, request.folders.name, relit, str(frames)),
        title=request.name,
        subtitle=request.shot.title,
        folder=request.folders.home / request.quality_name / "deliver",
        rate=rate,
        request=request,
        start=numbers[request.loop_dissolve],
        count=len(numbers) - request.loop_dissolve,
        facts=(("version", reader.version), *_facts(request, str(frames), len(numbers), rate), ("key", key)),
        content=[*reader.content(numbers), *([] if request.loop is None else [list(request.loop)])],
        lost=lost,
        has_coverage=all(reader.has_coverage(n) for n in finished),
        sounds=request.sounds,
        frames=lambda form: loop_frames(
            numbers, request.loop_dissolve, lambda shown: (reader.read(n, form) for n in shown), _mix
        ),
        loops=request.loop is not None,
        poster=lambda form: reader.read(finished[len(finished) // 2], form),
    )


def film_source(
    edit: Edit, requests: Sequence[RenderRequest], store: Store, failures: Failures, relit: str | None = None
) -> DeliverySource:
    """Return the film of an edit; `relit` names a relit version of every shot.

    Raises FrameError where all frames of its shots failed.
    """
    readers = [FrameReader(request, store, failures, relit) for request in requests]
    numbered = [(reader, n) for reader in readers for n in reader.request.requested]
    lost = _lost(numbered)
    finished = [(reader, n) for reader, n in numbered if reader.is_finished(n)]
    quality_name, rate = requests[0].quality_name, edit.frame_rate
    screen = requests[0].pictures.screen
    opening = next((words for words in edit.over if words.first == 0), edit.items[0])

    def frames(form: FrameFormat) -> Iterator[LabelledFrame]:
        def clip(index: int) -> Iterator[LabelledFrame]:
            return (readers[index].read(n, form) for n in readers[index].request.requested)

        def card(frame: Frame) -> LabelledFrame:
            return opaque(frame, form), {"quality": quality_name, "shot": edit.name}

        return edit.frames(screen, clip, card, _mix)

    poster, number = finished[len(finished) // 2]
    shots = dict.fromkeys(f"{reader.request.name} {reader.version}" for reader in readers)
    return DeliverySource(
        name=_name(requests[0], edit.name, relit),
        title=opening.title or edit.name,
        subtitle=opening.subtitle,
        folder=edit.path(quality_name).parent / "deliver",
        rate=rate,
        request=requests[0],
        start=FILM_START * ceil(rate.fps),
        count=edit.length,
        facts=(("shots", ", ".join(shots)), *_facts(requests[0], f"{edit.length}", edit.length, rate)),
        content=[
            to_plain(edit.items + edit.over),
            *(reader.content(reader.request.requested) for reader in readers),
        ],
        lost=lost,
        has_coverage=all(reader.has_coverage(n) for reader, n in finished),
        sounds=edit.sounds,
        frames=frames,
        poster=lambda form: poster.read(number, form),
    )


def _name(request: RenderRequest, *parts: str | None) -> str:
    """Return the name of a deliverable's files, with an end by which players know its projection."""
    return ".".join(filter(None, parts)) + NAME_ENDS.get(request.pictures.projection.kind, "")


def _mix(before: LabelledFrame, after: LabelledFrame, weight: Any) -> LabelledFrame:
    """Mix two frames; the labels are those of the one with more weight, or of a picture below words."""
    is_after = np.ndim(weight) == 0 and weight >= 0.5
    return mix_frames(before[0], after[0], weight), after[1] if is_after else before[1]


def _lost(numbered: Sequence[tuple[FrameReader, int]]) -> tuple[str, ...]:
    """Name the missing frames of each shot. Raises FrameError where all are missing."""
    lost = [(reader, n) for reader, n in numbered if not reader.is_finished(n)]
    if len(lost) == len(numbered):
        reader, number = lost[0]
        raise FrameError(
            f"{reader.request.name}: none of its frames could be made, so there is nothing to deliver; the "
            f"first error: {reader.reason(number)}"
        )
    by_shot: dict[str, list[int]] = {}
    for reader, number in lost:
        by_shot.setdefault(reader.request.name, []).append(number)
    return tuple(f"{name} frames {FrameRange.of(set(numbers))}" for name, numbers in by_shot.items())


def _facts(request: RenderRequest, frames: str, count: int, rate: FrameRate) -> tuple[tuple[str, str], ...]:
    quality = request.pictures.quality
    per_second = f"{rate.fps}" if rate.fps.denominator == 1 else f"{float(rate.fps):.3f} ({rate.fps})"
    length = float(Fraction(count) / rate.fps)
    width, height = quality.rendered_size
    most = "at most " if quality.is_adaptive else ""
    noise = f", denoised ({quality.denoise})" if quality.denoise != "off" else ""
    return (
        ("frames", frames if frames == str(count) else f"{frames}, {count} of them"),
        ("length", f"{length:.2f} s at {per_second} frames per second"),
        ("quality", f"{request.quality_name}, {most}{plural(quality.samples, 'sample')}{noise}"),
        ("size", f"{width} × {height}"),
    )


SLATES = ("head", "apart")  # the places of a slate: before the first frame, or in a file of its own

SLATE_SECONDS = 2


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
    audio: AudioClip | None = None
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
        make_folder(place)
        if not os.access(place, os.W_OK):
            raise MachineError(f"{place}: permission denied; choose another folder with -o")
        for encode, path, part in self._files():
            kind, key = KINDS[encode.suffix], self._key(encode, part)
            count = self._slate_frames if part == "slate" else self.source.count + self._leader
            passes = 2 if _measures_light(encode) or encode.suffix == GIF.suffix else 1
            reused = self.store.holds_whole(kind, key)
            if not reused:
                self.store.put(kind, key, partial(self._write, encode, part, bar(path.name, passes * count)))
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
        return (replace(self.options.audio, frames=self.source.count),)

    def _key(self, encode: Encode, part: str) -> str:
        """Return the key of a file: everything but its path."""
        source, options = self.source, self.options
        facts = [list(fact) for fact in source.facts]
        return key_of(
            DELIVER.recipe,
            [part, options.slate, list(options.burn_in.fields) if options.burn_in else None],
            asdict(encode),
            *([plugins().loaded[encode.name.partition(".")[0]].version] if "." in encode.name else []),
            [clip.content for clip in self._sounds] or None if encode.container.audio_codec else None,
            [str(source.rate), list(source.request.pictures.screen.picture), source.start, source.count],
            [source.has_coverage, source.name],
            [source.title, source.subtitle, facts] if options.slate else None,
            source.content,
        )

    def _write(self, encode: Encode, part: str, passed: Callable[[], None], path: Path) -> None:
        source, rate = self.source, self.source.rate.fps
        form = FrameFormat(encode.display, encode.alpha_format is not None and source.has_coverage)

        def frames() -> Iterator[Frame]:
            shown = self._slates(encode, form) if part == "slate" else self._frames(encode, form)
            return _counted(prefetch(shown), passed)

        if encode.suffix == GIF.suffix:
            write_gif(path, frames, rate, encode)
            return
        if is_gain_map(encode):
            write_gain_map(path, frames())
            return
        if encode.suffix == PNG.suffix:
            write_png(path, frames())
            return
        light = content_light(frames()) if _measures_light(encode) else None
        first = source.start - (self._slate_frames if part == "slate" else self._leader)
        sound = None
        if part == "frames" and encode.container.audio_codec:  # also under the slate before them
            clips = [clip.later(self._leader) for clip in self._sounds]
            sound = AudioClip.mix(clips, source.count + self._leader, source.rate)
        code = source.rate.timecode(first)
        loops = source.loops and part == "frames" and not self._leader
        write_movie(
            path, frames(), rate, encode, code, sound, source.request.pictures.projection, loops, light
        )

    def _frames(self, encode: Encode, form: FrameFormat) -> Iterator[Frame]:
        if self._leader:
            yield from self._slates(encode, form)
        for number, (frame, labels) in enumerate(self.source.frames(form), self.source.start):
            if self.options.burn_in is not None:
                facts = {**labels, "timecode": self.source.rate.timecode(number)}
                labelled = _labelled(self.options.burn_in, frame[..., :3], facts, form.display)
                frame = np.concatenate([labelled, frame[..., 3:]], axis=2)
            yield frame

    def _slates(self, encode: Encode, form: FrameFormat) -> Iterator[Frame]:
        """Yield the slate SLATE_SECONDS long."""
        source = self.source
        display = "rec709" if form.display in HDR_DISPLAYS else form.display  # a slate is graphics
        poster = source.poster(FrameFormat(display, False))[0].astype(np.float32) / np.float32(65535)
        facts = (*source.facts, ("made as", encode.name))
        slate = Slate(source.title, source.subtitle, facts, poster)
        screen = source.request.pictures.screen
        frame = opaque(screen.frame(slate.draw(screen.size)), form)
        for _ in range(self._slate_frames):
            yield frame


def _measures_light(encode: Encode) -> bool:
    """Tell whether files of an encode say what light their frames hold, so that all are read twice."""
    return encode.display == "pq" and not is_gain_map(encode)


def _labelled(
    burn_in: BurnIn, frame: Frame, facts: Mapping[str, str | int], display: str
) -> NDArray[np.uint16] | NDArray[np.uint8]:
    """Return a frame (H, W, 3) with facts over it, whose white is that of graphics."""
    if display not in HDR_DISPLAYS:
        return burn_in.over(frame, facts)
    inks = burn_in.over(np.zeros_like(frame), facts)
    kept = burn_in.over(np.full_like(frame, 65535), facts).astype(np.float32) - inks
    mixed = frame * (kept / np.float32(65535)) + hdr_graphics(inks, display)
    return np.asarray(np.rint(mixed).clip(0, 65535), dtype=np.uint16)


def _counted(frames: Iterator[Frame], passed: Callable[[], None]) -> Iterator[Frame]:
    """Yield the frames, and call `passed` after each."""
    for frame in frames:
        yield frame
        passed()


def lost_frames(deliveries: Sequence[Delivery]) -> list[str]:
    """Name the frames of all deliveries that cards stand for."""
    return list(dict.fromkeys(frame for delivery in deliveries for frame in delivery.source.lost))
