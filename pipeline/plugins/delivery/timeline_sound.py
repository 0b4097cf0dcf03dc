"""The sound of an edit as tracks of an OpenTimelineIO timeline: a film's own, or those of its shots.

Each sound refers to its file, with the part of it that is heard, counted in samples as movies have them.
Where two sounds are heard at once, as in a dissolve, they lie on two tracks; the one falls and the other
rises by transitions to and from silence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.production.request.audio import AudioClip, AudioTrack
from pipeline.production.request.edit import Edit
from pipeline.production.request.render_request import RenderRequest

LEVELS = ("gain", "fade_in", "fade_out")
"""Settings of a sound that stand in the metadata of its clip, by their names in the edit."""


@dataclass(frozen=True)
class HeardSound:
    """A sound where it is heard in a film, in samples.

    begins, ends  of the film
    skipped       of the file before what is heard
    length        of the whole file
    rise, fall    over which it comes and goes: dissolves
    request       of the shot that it is a sound of; None for the film's own
    """

    track: AudioTrack
    begins: int
    ends: int
    skipped: int
    length: int
    rise: int = 0
    fall: int = 0
    request: RenderRequest | None = None


def heard_sounds(edit: Edit, requests: Sequence[RenderRequest]) -> list[HeardSound]:
    """Return all sounds of a film in the order in which they begin.

    requests  of the clips, in order

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
    from render.movie.movie_sound import RATE, require_sound  # imports PyAV, which takes time

    def samples(frames: int) -> int:
        return round(frames / edit.frame_rate.fps * RATE)

    begin, run = samples(clip.first), samples(clip.frames)
    for track in clip.tracks:
        start = round((track.start - float(clip.skipped / edit.frame_rate.fps)) * RATE)
        length = round(require_sound(Path(track.file)) * RATE)
        first, last = max(0, start), min(run, start + length)
        if last > first:
            yield HeardSound(
                track,
                begin + first,
                begin + last,
                max(0, -start),
                length,
                max(0, samples(clip.rise) - first),
                max(0, samples(clip.fall) - (run - last)),
                request,
            )


def sound_tracks(sounds: Sequence[HeardSound], url: Callable[[Path], str], otio: Any) -> list[Any]:
    """Return as few tracks of opentimelineio as hold all sounds; none for none.

    sounds  in the order in which they begin
    url     returns the place of a file as the timeline names it
    """
    tracks: list[tuple[Any, int]] = []
    for sound in sounds:
        free = next((i for i, (_, end) in enumerate(tracks) if end < sound.begins), len(tracks))
        if free == len(tracks):
            name = f"sound {free + 1}" if free else "sound"
            tracks.append((otio.schema.Track(name, kind=otio.schema.TrackKind.Audio), 0))
        track, end = tracks[free]
        track.extend(_parts(sound, end, url, otio))
        tracks[free] = track, sound.ends
    for track, _ in tracks:
        if isinstance(track[-1], otio.schema.Transition):
            track.append(otio.schema.Gap(duration=track[-1].in_offset))
    return [track for track, _ in tracks]


def _parts(sound: HeardSound, end: int, url: Callable[[Path], str], otio: Any) -> Iterator[Any]:
    """Yield the silence since `end`, the last sample of the track, and the clip with its transitions."""
    from render.movie.movie_sound import RATE

    def time(samples: int) -> Any:
        return otio.opentime.RationalTime(samples, RATE)

    def fade(before: int, after: int) -> Any:
        kind = otio.schema.TransitionTypes.SMPTE_Dissolve
        return otio.schema.Transition("fade", kind, time(before), time(after))

    heard = sound.ends - sound.begins
    if sound.begins > end:
        yield otio.schema.Gap(duration=time(sound.begins - end))
    if sound.rise and sound.begins > end:
        yield fade(0, min(sound.rise, heard))
    file = Path(sound.track.file)
    media = otio.schema.ExternalReference(url(file), otio.opentime.TimeRange(time(0), time(sound.length)))
    shown = otio.opentime.TimeRange(time(sound.skipped), time(heard))
    clip = otio.schema.Clip(file.stem, media, shown)
    clip.metadata["flowsculpt"] = _facts(sound)
    yield clip
    if sound.fall:
        yield fade(min(sound.fall, heard), 0)


def _facts(sound: HeardSound) -> dict[str, Any]:
    """Return the settings of a sound; of a shot's also its name, its first frame and its start there."""
    facts = {name: getattr(sound.track, name) for name in LEVELS}
    if (request := sound.request) is None:
        return facts
    place = {"first_frame": min(request.angles), "start": sound.track.start}
    return {**facts, "shot": request.name, **place}
