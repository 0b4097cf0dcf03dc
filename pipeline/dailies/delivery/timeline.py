"""An edit as an OpenTimelineIO timeline, which editing programs open: clips, dissolves, cards and sound.

Times count frames of the shots themselves, as timecode in deliverables does: frame 42 of a shot is at 42.
Where two clips dissolve, the cut stands in the middle, and each shows its frames beyond it as a handle.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipeline.frames import FrameRange
from pipeline.production.request.edit import Edit, EditItem
from pipeline.production.request.render_request import RenderRequest
from render.base.atomic_write import atomic_write
from render.movie.codecs import ENCODES, Encode
from render.movie.sequences import FILM_START

MEDIA = ("frames", *(name for name, encode in ENCODES.items() if encode.has_timecode))
"""The media that clips refer to: finished frames, or deliverables of whole shots."""


@dataclass(frozen=True)
class Timeline:
    """An edit to be written as an OpenTimelineIO file.

    root   the folder that paths are relative to
    media  one of MEDIA
    place  the file; it names media relative to its own folder
    """

    edit: Edit
    requests: Sequence[RenderRequest]
    root: Path
    media: str
    place: Path

    def write(self) -> None:
        """Write the file.

        Raises MachineError where the disk refuses, MissingImageError or CorruptImageError for
        sound that cannot be read.
        """
        timeline = self.build()
        with atomic_write(self.place) as temporary:
            temporary.write_text(timeline.to_json_string(indent=2) + "\n", encoding="utf-8")

    def build(self) -> Any:
        """Return the timeline as an object of opentimelineio."""
        import opentimelineio as otio

        start = self._time(FILM_START * ceil(self._fps))
        timeline = otio.schema.Timeline(self.edit.name, global_start_time=start)
        pictures = otio.schema.Track("pictures", kind=otio.schema.TrackKind.Video)
        for part in self._parts():
            pictures.append(part)
        timeline.tracks.append(pictures)
        if self.edit.audio is not None:
            timeline.tracks.append(self._sound())
        return timeline

    def _parts(self) -> Iterator[Any]:
        """Yield clips and cards, with the dissolves between them."""
        import opentimelineio as otio

        items = self.edit.items
        for index, item in enumerate(items):
            after = items[index + 1].dissolve if index + 1 < len(items) else 0
            if item.dissolve:
                before = item.dissolve // 2
                yield otio.schema.Transition(
                    "dissolve",
                    otio.schema.TransitionTypes.SMPTE_Dissolve,
                    self._time(before),
                    self._time(item.dissolve - before),
                )
            handles = item.dissolve // 2, after - after // 2
            yield from self._card(item, *handles) if item.clip is None else self._clips(item, *handles)

    def _clips(self, item: EditItem, head: int, tail: int) -> Iterator[Any]:
        """Yield a clip without its handles, in runs of one speed."""
        import opentimelineio as otio

        assert item.clip is not None, "a card has no frames"
        request = self.requests[item.clip]
        numbers = request.requested[head : item.frames - tail]
        for run in _runs(numbers):
            step = run[1] - run[0] if len(run) > 1 else 1
            clip = otio.schema.Clip(request.name, self._reference(request), self._range(run[0], len(run)))
            if step != 1:
                clip.effects.append(otio.schema.LinearTimeWarp(time_scalar=float(step)))
            clip.metadata["flowsculpt"] = {"quality": request.quality_name, "title": request.shot.title}
            yield clip

    def _card(self, item: EditItem, head: int, tail: int) -> Iterator[Any]:
        import opentimelineio as otio

        words = {"title": item.title, "subtitle": item.subtitle}
        card = otio.schema.GeneratorReference("card", "flowsculpt card", self._range(0, item.frames), words)
        yield otio.schema.Clip(item.title or "card", card, self._range(head, item.frames - head - tail))

    def _reference(self, request: RenderRequest) -> Any:
        """Return a reference to all frames of a shot."""
        import opentimelineio as otio

        frames = sorted(request.angles)
        available = self._range(frames[0], len(frames))
        if self.media in ENCODES:
            return otio.schema.ExternalReference(
                self._url(_delivered(request, ENCODES[self.media])), available
            )
        place = request.place("frame", frames[0])
        return otio.schema.ImageSequenceReference(
            target_url_base=f"{self._url(place.parent)}/",
            name_prefix=f"{request.folders.name}.",
            name_suffix=place.suffix,
            start_frame=frames[0],
            frame_step=1,
            rate=self._fps,
            frame_zero_padding=4,
            available_range=available,
        )

    def _sound(self) -> Any:
        """Return a track of the film's sound, at most as long as the film."""
        import opentimelineio as otio

        from render.movie.sound import RATE, require_sound

        audio = self.edit.audio
        assert audio is not None, "films without sound have no track"
        first = round(audio.start * RATE)
        film = round(self.edit.length / self.edit.frame_rate.fps * RATE)
        length = round(require_sound(Path(audio.file)) * RATE)
        track = otio.schema.Track("sound", kind=otio.schema.TrackKind.Audio)
        if first > 0:
            track.append(otio.schema.Gap(duration=otio.opentime.RationalTime(min(first, film), RATE)))
        left_out = max(0, -first)
        shown = min(length - left_out, film - max(0, first))
        if shown > 0:
            available = _samples(0, length)
            reference = otio.schema.ExternalReference(self._url(Path(audio.file)), available)
            clip = otio.schema.Clip(Path(audio.file).stem, reference, _samples(left_out, shown))
            facts = {"gain": audio.gain, "fade_in": audio.fade_in, "fade_out": audio.fade_out}
            clip.metadata["flowsculpt"] = facts
            track.append(clip)
        return track

    def _url(self, path: Path) -> str:
        """Return a path relative to the timeline's folder, so that both can move together."""
        relative = os.path.relpath(self.root / path, self.place.absolute().parent)
        return quote(Path(relative).as_posix())

    @property
    def _fps(self) -> float:
        return float(self.edit.frame_rate.fps)

    def _time(self, frames: int) -> Any:
        import opentimelineio as otio

        return otio.opentime.RationalTime(frames, self._fps)

    def _range(self, first: int, count: int) -> Any:
        import opentimelineio as otio

        return otio.opentime.TimeRange(self._time(first), self._time(count))


def _samples(first: int, count: int) -> Any:
    import opentimelineio as otio

    from render.movie.sound import RATE

    time = otio.opentime.RationalTime
    return otio.opentime.TimeRange(time(first, RATE), time(count, RATE))


def _delivered(request: RenderRequest, encode: Encode) -> Path:
    """Return the path that `flowsculpt deliver` writes a whole shot to."""
    name = f"{request.folders.name}.{FrameRange.of(request.angles)}.{encode.name}{encode.suffix}"
    return request.folders.home / request.quality_name / "deliver" / name


def _runs(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    """Split frame numbers into runs of one step each."""
    start = 0
    while start < len(numbers):
        end = start + 1
        while (
            end + 1 < len(numbers) and numbers[end + 1] - numbers[end] == numbers[start + 1] - numbers[start]
        ):
            end += 1
        end = min(end, len(numbers) - 1)
        yield numbers[start : end + 1]
        start = end + 1
