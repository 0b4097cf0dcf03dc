"""The sound of an imported timeline: one file, or those of its shots as they are."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from opentimelineio import schema

from flowsculpt import UsageError
from flowsculpt.api import shorten
from flowsculpt.pipeline.plugins.delivery.timeline_times import available_range, is_on

LEVELS = ("gain", "fade_in", "fade_out")
"""Settings of a sound that stand in the metadata of its clip, by their names in the edit."""


@dataclass(frozen=True)
class ImportedSound:
    """The sounds of a timeline whose track of pictures has `rate` frames a second."""

    timeline: Any
    pictures: Any
    rate: float

    def setting(self, folder: Path, edits: Path) -> Mapping[str, Any]:
        """Return the film's own sound, if the timeline has one file of it, as the edit writes it.

        folder  of the timeline; `edits` is that of the edit

        An edit without sound has those of its shots, so nothing is written of them. Raises UsageError for
        what an edit cannot say.
        """
        clips = [clip for track in self.timeline.audio_tracks() for clip in track.find_clips()]
        of_shots = [clip for clip in clips if _facts(clip).get("shot")]
        own = [clip for clip in clips if not _facts(clip).get("shot") and is_on(clip)]
        if own and of_shots:
            raise UsageError(
                f"it has {shorten(own[0].name)} and sounds of its shots; a film has either its own sound "
                "or theirs. Mix them down to one file, or remove one kind."
            )
        moved = next((clip for clip in of_shots if not self._is_under_its_picture(clip)), None)
        if moved is not None:
            raise UsageError(
                f"{shorten(moved.name)} is disabled, or not where shot {_facts(moved)['shot']} has it; an "
                "edit has the sounds of its shots as they are. Move it back, or mix the sounds down to one "
                "file."
            )
        if len(own) > 1:
            raise UsageError(f"it has {len(own)} pieces of sound; a film has one. Mix them down.")
        if not own:
            return {}
        (clip,) = own
        if fault := self._fault(clip):
            raise UsageError(f"sound {shorten(clip.name)}: {fault}. Mix it down to one file.")
        file = folder / unquote(urlsplit(clip.media_reference.target_url).path)
        facts = {name: float(_facts(clip)[name]) for name in LEVELS if _facts(clip).get(name)}
        start = round(_begin(clip) - _skipped(clip), 6)
        return {"sound": {"file": os.path.relpath(file, edits), "start": start, **facts}}

    def _fault(self, clip: Any) -> str:
        """Return why the film would have a sound otherwise than the timeline; empty if it has it so.

        An edit plays a file from its beginning, or that of the film, to its end or that of the film.
        """
        track, span, available = clip.parent(), clip.trimmed_range(), available_range(clip)
        if not isinstance(clip.media_reference, schema.ExternalReference):
            return f"its media is a {type(clip.media_reference).__name__}, not a file"
        if not isinstance(track, schema.Track):
            return "it is in a stack"
        if any(effect.enabled for effect in (*clip.effects, *track.effects)):
            return "it has an effect, which an edit has not"
        if track.source_range or any(isinstance(it, schema.Transition) for it in track.neighbors_of(clip)):
            return "its track is trimmed, or it fades by a transition"
        if available is None and span.start_time.value:
            return "its media has no available_range, so where it begins is unknown"
        begin, skipped, near = _begin(clip), _skipped(clip), 0.5 / self.rate
        length, film = span.duration.to_seconds(), self.pictures.duration().to_seconds()
        if not (abs(begin - skipped) < 86_400.0 and 0.0 < length < 86_400.0):
            return "its times are out of range"
        if begin > near and skipped > near:
            return "it begins within its file and within the film"
        whole = length if available is None else available.duration.to_seconds() - skipped
        is_cut = length < min(whole, film - begin) - near
        return "it ends before its file and before the film" if is_cut else ""

    def _is_under_its_picture(self, sound: Any) -> bool:
        """Tell whether the sound of a shot is heard at the frame of the shot at which the shot has it.

        Where clips dissolve, it begins before its clip: the frames beyond the cut are counted on.
        """
        facts = _facts(sound)
        expected = float(facts["first_frame"]) / self.rate + _skipped(sound) + float(facts["start"])
        for clip in self.pictures.find_clips():
            if clip.effects or clip.name != facts["shot"] or sound.effects or not is_on(sound):
                continue
            seen = clip.trimmed_range().start_time.to_seconds() + _begin(sound) - _begin(clip)
            if abs(seen - expected) < 0.5 / self.rate:
                return True
        return False


def _facts(clip: Any) -> Mapping[str, Any]:
    """Return what our export wrote with the sound of a clip; nothing for clips of other programs."""
    found = clip.metadata.get("flowsculpt", {})
    return found if isinstance(found, Mapping) else {}


def _begin(clip: Any) -> float:
    """Return the second of the film at which a clip begins, without what dissolves before it."""
    return float(clip.range_in_parent().start_time.to_seconds())


def _skipped(clip: Any) -> float:
    """Return the seconds of its media before a clip."""
    start, available = clip.trimmed_range().start_time, available_range(clip)
    return float((start if available is None else start - available.start_time).to_seconds())
