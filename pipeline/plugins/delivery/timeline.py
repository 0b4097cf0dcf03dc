"""An edit as an OpenTimelineIO timeline, which editing programs open: clips, dissolves, cards and sound.

Times count frames of the shots themselves, as timecode in deliverables does: frame 42 of a shot is at 42.
Where two clips dissolve, the cut stands in the middle, and each shows its frames beyond it as a handle.

Each sound refers to its file, with the part of it that is heard, counted in samples as movies have them.
Where two sounds are heard at once, as in a dissolve, they lie on two tracks; the one falls and the other
rises by transitions to and from silence.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Annotated, Any
from urllib import parse

import typer
from opentimelineio import opentime, schema

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import print_result, require_one_of
from flowsculpt.api.files import to_plain
from flowsculpt.api.frames import Edit, FrameRange, RenderRequest, Show, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Quality, ShotOptions, shared_option
from flowsculpt.api.pictures import ENCODES, AudioClip, Encode
from flowsculpt.pipeline.plugins.delivery.delivered_names import FILM_START, NAME_ENDS
from flowsculpt.pipeline.plugins.delivery.imported_sound import LEVELS
from flowsculpt.pipeline.plugins.delivery.timeline_times import CARD

RATE = 48_000  # samples of sound in a second, as movies have them


@dataclass(frozen=True)
class HeardSound:
    """A sound where it is heard in a film, in samples.

    file          of the sound
    levels        its settings, by the names of LEVELS
    start         second of the shot or of the film at which the file begins
    begins, ends  of the film
    skipped       of the file before what is heard
    length        of the whole file
    rise, fall    over which it comes and goes: dissolves
    request       of the shot that it is a sound of; None for the film's own
    """

    file: Path
    levels: Mapping[str, float]
    start: float
    begins: int
    ends: int
    skipped: int
    length: int
    rise: int = 0
    fall: int = 0
    request: RenderRequest | None = None


def heard_sounds(edit: Edit, requests: Sequence[RenderRequest]) -> list[HeardSound]:
    """Return all sounds of a film in the order in which they begin; `requests` are of its clips, in order.

    Raises MissingInputError or BadInputError for sound that cannot be read.
    """
    shots = {} if edit.audio else dict(_shots_by_begin(edit, requests))
    sounds = [sound for clip in edit.sounds for sound in _heard(edit, clip, shots.get(clip.first))]
    return sorted(sounds, key=lambda sound: sound.begins)


def _shots_by_begin(edit: Edit, requests: Sequence[RenderRequest]) -> Iterator[tuple[int, RenderRequest]]:
    """Yield the frame of the film at which each clip begins, and the request of its shot."""
    first = 0
    for item in edit.items:
        first -= item.dissolve
        if item.clip is not None:
            yield first, requests[item.clip]
        first += item.frames


def _heard(edit: Edit, clip: AudioClip, request: RenderRequest | None) -> Iterator[HeardSound]:
    """Yield the sounds that are heard under a run of frames, as `AudioClip.segment` places them."""

    def samples(frames: int) -> int:
        return round(frames / edit.frame_rate.fps * RATE)

    begin, run = samples(clip.first), samples(clip.frames)
    for track in clip.tracks:
        start = round((track.start - float(clip.skipped / edit.frame_rate.fps)) * RATE)
        length = round(track.seconds * RATE)
        first, last = max(0, start), min(run, start + length)
        if last > first:
            yield HeardSound(
                Path(track.file),
                {name: getattr(track, name) for name in LEVELS},
                track.start,
                begin + first,
                begin + last,
                max(0, -start),
                length,
                max(0, samples(clip.rise) - first),
                max(0, samples(clip.fall) - (run - last)),
                request,
            )


def sound_tracks(sounds: Sequence[HeardSound], url: Callable[[Path], str]) -> list[Any]:
    """Return as few tracks of opentimelineio as hold sounds, which are in the order in which they begin."""
    tracks: list[tuple[Any, int]] = []
    for sound in sounds:
        free = next((i for i, (_, end) in enumerate(tracks) if end < sound.begins), len(tracks))
        if free == len(tracks):
            name = f"sound {free + 1}" if free else "sound"
            tracks.append((schema.Track(name, kind=schema.TrackKind.Audio), 0))
        track, end = tracks[free]
        track.extend(_parts(sound, end, url))
        tracks[free] = track, sound.ends
    for track, _ in tracks:
        if isinstance(track[-1], schema.Transition):
            track.append(schema.Gap(duration=track[-1].in_offset))
    return [track for track, _ in tracks]


def _parts(sound: HeardSound, end: int, url: Callable[[Path], str]) -> Iterator[Any]:
    """Yield the silence since `end`, the last sample of the track, and the clip with its transitions."""

    def time(samples: int) -> Any:
        return opentime.RationalTime(samples, RATE)

    def fade(before: int, after: int) -> Any:
        kind = schema.TransitionTypes.SMPTE_Dissolve
        return schema.Transition("fade", kind, time(before), time(after))

    heard = sound.ends - sound.begins
    if sound.begins > end:
        yield schema.Gap(duration=time(sound.begins - end))
    if sound.rise and sound.begins > end:
        yield fade(0, min(sound.rise, heard))
    media = schema.ExternalReference(url(sound.file), opentime.TimeRange(time(0), time(sound.length)))
    shown = opentime.TimeRange(time(sound.skipped), time(heard))
    clip = schema.Clip(sound.file.stem, media, shown)
    clip.metadata["flowsculpt"] = _facts(sound)
    yield clip
    if sound.fall:
        yield fade(min(sound.fall, heard), 0)


def _facts(sound: HeardSound) -> dict[str, Any]:
    """Return the settings of a sound; of a shot's also its name, its first frame and its start there."""
    facts = dict(sound.levels)
    if (request := sound.request) is None:
        return facts
    place = {"first_frame": min(request.angles), "start": sound.start}
    return {**facts, "shot": request.name, **place}


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
        timeline = schema.Timeline(self.edit.name, global_start_time=start)
        pictures = schema.Track("pictures", kind=schema.TrackKind.Video)
        for part in self._parts():
            pictures.append(part)
        timeline.tracks.append(pictures)
        if self.edit.over:
            timeline.tracks.append(self._titles())
        timeline.tracks.extend(sound_tracks(heard_sounds(self.edit, self.requests), self._url))
        return timeline

    def _parts(self) -> Iterator[Any]:
        """Yield clips and cards, with the dissolves between them."""
        items = self.edit.items
        for index, item in enumerate(items):
            after = items[index + 1].dissolve if index + 1 < len(items) else 0
            if item.dissolve:
                before = item.dissolve // 2
                yield schema.Transition(
                    "dissolve",
                    schema.TransitionTypes.SMPTE_Dissolve,
                    self._time(before),
                    self._time(item.dissolve - before),
                )
            shown = slice(item.dissolve // 2, item.frames - (after - after // 2))  # without its handles
            if item.clip is None:
                yield self._card(item, shown)
            else:
                yield from self._clips(self.requests[item.clip], shown)

    def _clips(self, request: RenderRequest, shown: slice) -> Iterator[Any]:
        """Yield the part of a clip that is shown, in runs of one speed."""
        for run in _runs(request.requested[shown]):
            step = run[1] - run[0] if len(run) > 1 else 1
            clip = schema.Clip(request.name, self._reference(request), self._range(run[0], len(run)))
            if step != 1:
                clip.effects.append(schema.LinearTimeWarp(time_scalar=float(step)))
            clip.metadata["flowsculpt"] = {"quality": request.quality_name, "title": request.shot.title}
            yield clip

    def _card(self, item: Any, shown: slice) -> Any:
        words = {"title": item.title, "subtitle": item.subtitle}
        if style := to_plain(item.style):
            words["style"] = style
        card = schema.GeneratorReference("card", CARD, self._range(0, item.frames), words)
        part = self._range(shown.start, shown.stop - shown.start)
        return schema.Clip(item.title or "card", card, part)

    def _titles(self) -> Any:
        """Return the track with the words that lie over pictures."""
        track, at = schema.Track("titles", kind=schema.TrackKind.Video), 0
        for item in self.edit.over:
            if item.first > at:
                track.append(schema.Gap(source_range=self._range(0, item.first - at)))
            track.append(self._card(item, slice(0, item.frames)))
            at = item.first + item.frames
        return track

    def _reference(self, request: RenderRequest) -> Any:
        """Return a reference to all frames of a shot."""
        frames = sorted(request.angles)
        available = self._range(frames[0], len(frames))
        if self.media in ENCODES:
            return schema.ExternalReference(self._url(_delivered(request, ENCODES[self.media])), available)
        place = request.place("frame", frames[0])
        return schema.ImageSequenceReference(
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
        return parse.quote(Path(relative).as_posix())

    @property
    def _fps(self) -> float:
        return float(self.edit.frame_rate.fps)

    def _time(self, frames: int) -> Any:
        return opentime.RationalTime(frames, self._fps)

    def _range(self, first: int, count: int) -> Any:
        return opentime.TimeRange(self._time(first), self._time(count))


def _delivered(request: RenderRequest, encode: Encode) -> Path:
    """Return the path that `flowsculpt deliver` writes a whole shot to."""
    end = NAME_ENDS.get(request.pictures.projection.kind, "")
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


def otio(
    common: Common,
    options: ShotOptions,
    edit: Annotated[
        str, typer.Argument(metavar="EDIT", help="An edit: its name in shots/, or the path of its file.")
    ] = Show().film.stem,
    output: Annotated[Path | None, shared_option("output", "Write this file. Default: EDIT.otio.")] = None,
    media: Annotated[
        str, typer.Option(metavar="NAME", help=f"What clips refer to: {', '.join(MEDIA)}.")
    ] = "frames",
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Write the timeline of an edit for editing programs, in OpenTimelineIO.

    `flowsculpt export otio showreel -q final` writes showreel.otio: clips, dissolves, cards and sound of
    shots/showreel.yaml. Clips refer to frames, relative to the file, or to files that `flowsculpt deliver`
    wrote: `--media prores4444`.
    """
    require_one_of(media, MEDIA, f"--media {media}: clips cannot refer to it.")
    project = options.project(common)
    path = Show().find_edit(edit)
    place = output or Path(f"{path.stem}.otio")
    if place.suffix != ".otio":
        raise UsageError(f"{place}: a timeline's name ends in .otio; call it {place.stem}.otio")
    cut, requests = project.edit(quality, path)
    if not common.dry_run:
        Timeline(cut, requests, common.root, media, place).write()
    done = f"{place}: {plural(cut.length, 'frame')}, {common.done('written')}."
    print_result(done, {"timeline": str(place), "frames": cut.length, "media": media}, common.json)
