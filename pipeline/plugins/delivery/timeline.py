"""An edit as an OpenTimelineIO timeline, which editing programs open: clips, dissolves, cards and sound.

Times count frames of the shots themselves, as timecode in deliverables does: frame 42 of a shot is at 42.
Where two clips dissolve, the cut stands in the middle, and each shows its frames beyond it as a handle.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipeline.frames import FrameRange
from pipeline.plugins.delivery.timeline_sound import heard_sounds, sound_tracks
from pipeline.production.request.edit import Edit, EditItem
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store
from render.movie.codecs import ENCODES, FILM_START, NAME_ENDS, Encode

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

        Raises MachineError where the disk refuses, MissingInputError or BadInputError for
        sound that cannot be read.
        """
        timeline = self.build()
        text = timeline.to_json_string(indent=2) + "\n"
        Store(self.root).write(self.place, lambda draft: draft.write_text(text, encoding="utf-8"))

    def build(self) -> Any:
        """Return the timeline as an object of opentimelineio."""
        start = self._time(FILM_START * ceil(self._fps))
        timeline = self._otio.schema.Timeline(self.edit.name, global_start_time=start)
        pictures = self._otio.schema.Track("pictures", kind=self._otio.schema.TrackKind.Video)
        for part in self._parts():
            pictures.append(part)
        timeline.tracks.append(pictures)
        timeline.tracks.extend(sound_tracks(heard_sounds(self.edit, self.requests), self._url, self._otio))
        return timeline

    def _parts(self) -> Iterator[Any]:
        """Yield clips and cards, with the dissolves between them."""
        items = self.edit.items
        for index, item in enumerate(items):
            after = items[index + 1].dissolve if index + 1 < len(items) else 0
            if item.dissolve:
                before = item.dissolve // 2
                yield self._otio.schema.Transition(
                    "dissolve",
                    self._otio.schema.TransitionTypes.SMPTE_Dissolve,
                    self._time(before),
                    self._time(item.dissolve - before),
                )
            handles = item.dissolve // 2, after - after // 2
            yield from self._card(item, *handles) if item.clip is None else self._clips(item, *handles)

    def _clips(self, item: EditItem, head: int, tail: int) -> Iterator[Any]:
        """Yield a clip without its handles, in runs of one speed."""
        assert item.clip is not None, "a card has no frames"
        request = self.requests[item.clip]
        numbers = request.requested[head : item.frames - tail]
        for run in _runs(numbers):
            step = run[1] - run[0] if len(run) > 1 else 1
            clip = self._otio.schema.Clip(
                request.name, self._reference(request), self._range(run[0], len(run))
            )
            if step != 1:
                clip.effects.append(self._otio.schema.LinearTimeWarp(time_scalar=float(step)))
            clip.metadata["flowsculpt"] = {"quality": request.quality_name, "title": request.shot.title}
            yield clip

    def _card(self, item: EditItem, head: int, tail: int) -> Iterator[Any]:
        words = {"title": item.title, "subtitle": item.subtitle}
        card = self._otio.schema.GeneratorReference(
            "card", "flowsculpt card", self._range(0, item.frames), words
        )
        yield self._otio.schema.Clip(item.title or "card", card, self._range(head, item.frames - head - tail))

    def _reference(self, request: RenderRequest) -> Any:
        """Return a reference to all frames of a shot."""
        frames = sorted(request.angles)
        available = self._range(frames[0], len(frames))
        if self.media in ENCODES:
            return self._otio.schema.ExternalReference(
                self._url(_delivered(request, ENCODES[self.media])), available
            )
        place = request.place("frame", frames[0])
        return self._otio.schema.ImageSequenceReference(
            target_url_base=f"{self._url(place.parent)}/",
            name_prefix=f"{request.folders.name}.",
            name_suffix=place.suffix,
            start_frame=frames[0],
            frame_step=1,
            rate=self._fps,
            frame_zero_padding=4,
            available_range=available,
        )

    def _url(self, path: Path) -> str:
        """Return a path relative to the timeline's folder, so that both can move together."""
        relative = os.path.relpath(self.root / path, self.place.absolute().parent)
        return quote(Path(relative).as_posix())

    @property
    def _fps(self) -> float:
        return float(self.edit.frame_rate.fps)

    @cached_property
    def _otio(self) -> Any:
        import opentimelineio  # which takes 0.2 s; `export` reads MEDIA for its help

        return opentimelineio

    def _time(self, frames: int) -> Any:
        return self._otio.opentime.RationalTime(frames, self._fps)

    def _range(self, first: int, count: int) -> Any:
        return self._otio.opentime.TimeRange(self._time(first), self._time(count))


def _delivered(request: RenderRequest, encode: Encode) -> Path:
    """Return the path that `flowsculpt deliver` writes a whole shot to."""
    end = NAME_ENDS.get(request.projection.kind, "")
    name = encode.file_name(f"{request.folders.name}.{FrameRange.of(request.angles)}{end}")
    return request.folders.home / request.quality_name / "deliver" / name


def _runs(numbers: Sequence[int]) -> Iterator[list[int]]:
    """Split frame numbers into runs of one step each."""
    run: list[int] = []
    for number in numbers:
        if len(run) > 1 and number - run[-1] != run[1] - run[0]:
            yield run
            run = []
        run.append(number)
    if run:
        yield run
