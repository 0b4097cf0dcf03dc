"""An OpenTimelineIO timeline as an edit: what an editor cut becomes a YAML file that names shots and frames.

It is the reverse of `timeline.py`: of the pictures, clips, dissolves and cards; of the sound, one file, or
those of the shots where these have them. What an edit cannot say, such as two pictures on top of each other
or a gap, is refused with its place.
"""

from __future__ import annotations

import io
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from opentimelineio import adapters, schema
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from pipeline.errors import FlowsculptError, ShotError, UsageError, suggestion
from pipeline.file_contents import as_utf8
from pipeline.frames import FrameRange, FrameRate
from pipeline.plugins.delivery.timeline import LEVELS
from pipeline.shot.yaml.named_files import shown
from render.base.input_files import read_input

SUFFIX = ".otio"

_FIRST_LINE = "# Made from {name} by flowsculpt film --edit, which replaces this file.\n"


def edit_of(timeline: Path, shots: Collection[str], folder: Path) -> tuple[Path, str]:
    """Return the file of a timeline's edit, and its text. Raises what `ImportedEdit.text` raises."""
    imported = ImportedEdit(timeline, shots, folder)
    return imported.target, imported.text()


@dataclass(frozen=True)
class ImportedEdit:
    """A timeline to be read as an edit.

    file    the timeline
    shots   names of the shots that its clips may show
    folder  where the edit will lie; files are named relative to it
    """

    file: Path
    shots: Collection[str]
    folder: Path

    @property
    def target(self) -> Path:
        """The edit that is written."""
        return self.folder / f"{self.file.stem}.yaml"

    def text(self) -> str:
        """Return the edit as YAML.

        Raises MissingInputError where the timeline is not there, ShotError with all in it that no edit can
        say, and UsageError where the edit would replace one that was not made from a timeline.
        """
        first = _FIRST_LINE.format(name=self.file.name)
        if self.target.exists() and not self.target.read_text(encoding="utf-8").startswith(first):
            raise UsageError(f"{self.target} was not made from {self.file.name}, but exists; rename one")
        rate = self._rate
        written: dict[str, Any] = {"title": self._timeline.name or self.file.stem}
        entries, faults = self._entries(rate)
        if faults:
            raise ShotError(*(f"{shown(self.file)}: {fault}" for fault in faults))
        written |= {"shots": entries, **self._sound(), "rate": str(rate)}
        written |= {"title_seconds": 0, "credits_seconds": 0}  # those of the timeline are cards
        yaml, stream = YAML(), io.StringIO()
        yaml.width = 100
        yaml.dump(written, stream)
        return first + stream.getvalue()

    @cached_property
    def _timeline(self) -> Any:
        try:
            text = as_utf8(read_input(self.file)).decode()
            found = adapters.read_from_string(text, "otio_json")
        except FlowsculptError:
            raise
        except Exception as error:  # of many kinds, by what the file holds
            fact = " ".join(str(error).split())[:200]
            raise ShotError(f"{shown(self.file)}: it cannot be read as OpenTimelineIO ({fact})") from None
        if not isinstance(found, schema.Timeline):
            raise ShotError(f"{shown(self.file)}: it holds a {type(found).__name__}; export a timeline")
        return found

    @cached_property
    def _pictures(self) -> Any:
        """The one track of pictures that shows anything."""
        tracks = [track for track in self._timeline.video_tracks() if len(list(track.find_clips()))]
        if len(tracks) != 1:
            raise ShotError(
                f"{shown(self.file)}: it has {len(tracks)} tracks of pictures; an edit has one picture "
                "track. Flatten them."
            )
        return tracks[0]

    @property
    def _rate(self) -> FrameRate:
        first, *_ = self._pictures.find_clips()
        return FrameRate.of(round(float(first.trimmed_range().duration.rate), 3))

    def _entries(self, rate: FrameRate) -> tuple[list[Any], list[str]]:
        """Return the entries of the edit, and what is wrong."""
        entries: list[Any] = []
        faults: list[str] = []
        parts = list(self._pictures)
        for index, part in enumerate(parts):
            if isinstance(part, schema.Transition):
                continue
            place = f"entry {index + 1} ({part.name or type(part).__name__})"
            before, after = (parts[i] if 0 <= i < len(parts) else None for i in (index - 1, index + 1))
            head = self._offset(before, "in_offset", rate)
            tail = self._offset(after, "out_offset", rate)
            dissolve = head + self._offset(before, "out_offset", rate)
            try:
                entry = self._entry(part, head, tail, rate)
            except UsageError as error:
                faults.append(f"{place}: {error}")
                continue
            line = CommentedMap(entry | ({"dissolve": dissolve} if dissolve else {}))
            line.fa.set_flow_style()
            entries.append(line)
        return entries, faults

    def _offset(self, part: Any, name: str, rate: FrameRate) -> int:
        if not isinstance(part, schema.Transition):
            return 0
        return round(getattr(part, name).rescaled_to(float(rate.fps)).value)

    def _entry(self, part: Any, head: int, tail: int, rate: FrameRate) -> dict[str, Any]:
        """Return a clip or a card; `head` and `tail` are its frames beyond the cuts, where it dissolves."""
        if not isinstance(part, schema.Clip):
            kind = type(part).__name__
            raise UsageError(f"it is a {kind}, which an edit cannot hold; close it, or show a card")
        shown_range = part.trimmed_range()
        first = round(shown_range.start_time.rescaled_to(float(rate.fps)).value)
        count = round(shown_range.duration.rescaled_to(float(rate.fps)).value)
        reference = part.media_reference
        if isinstance(reference, schema.GeneratorReference):
            words = {name: str(text) for name, text in reference.parameters.items() if text}
            return {
                "card": words.get("title", part.name or "Card"),
                **({"subtitle": words["subtitle"]} if "subtitle" in words else {}),
                "seconds": round((head + count + tail) / float(rate.fps), 6),
            }
        step = self._step(part)
        numbers = [first + step * n for n in range(-head, count + tail)]
        backwards = ",".join(map(str, numbers))  # a range would be in ascending order
        frames = str(FrameRange.of(numbers)) if step > 0 else backwards
        return {"shot": self._shot_of(part), "frames": frames}

    def _step(self, clip: Any) -> int:
        """Return the frames from one picture of a clip to the next."""
        if not clip.effects:
            return 1
        (effect, *more) = clip.effects
        step = getattr(effect, "time_scalar", 0.5)
        if more or step != int(step) or not step:
            raise UsageError("it has an effect other than a whole speed; an edit shows frames as they are")
        return int(step)

    def _shot_of(self, clip: Any) -> str:
        """Return the shot that a clip shows, by its name or that of its media."""
        reference = clip.media_reference
        media = unquote(urlsplit(getattr(reference, "target_url", "") or "").path)
        names = [clip.name, getattr(reference, "name_prefix", "").rstrip("._")]
        names.append(Path(media).name.partition(".")[0])
        known = next((name for name in names if name in self.shots), None)
        if known is None:
            named = next((name for name in names if name), "a clip without a name")
            raise UsageError(f"{named} is not a shot in {self.folder}. {suggestion(named, self.shots)}")
        return known

    def _sound(self) -> Mapping[str, Any]:
        """Return the film's own sound, if the timeline has one file of it.

        An edit without sound has those of its shots, so nothing is written of them.
        """
        clips = [
            clip
            for track in self._timeline.audio_tracks()
            for clip in track.find_clips()
            if isinstance(clip.media_reference, schema.ExternalReference)
        ]
        of_shots = [clip for clip in clips if _facts(clip).get("shot")]
        own = [clip for clip in clips if not _facts(clip).get("shot")]
        if own and of_shots:
            raise self._refused(
                f"it has {own[0].name} and sounds of its shots; a film has either its own sound or theirs. "
                "Mix them down to one file, or remove one kind."
            )
        moved = next((clip for clip in of_shots if not self._is_under_its_picture(clip)), None)
        if moved is not None:
            raise self._refused(
                f"{moved.name} is not where shot {_facts(moved)['shot']} has it; an edit has the sounds of "
                "its shots as they are. Move it back, or mix the sounds down to one file."
            )
        if len(own) > 1:
            raise self._refused(f"it has {len(own)} pieces of sound; a film has one. Mix them down.")
        if not own:
            return {}
        (clip,) = own
        url = urlsplit(clip.media_reference.target_url)
        file = self.file.parent / unquote(url.path)
        seconds = _begin(clip) - clip.trimmed_range().start_time.to_seconds()
        facts = {name: float(_facts(clip)[name]) for name in LEVELS if _facts(clip).get(name)}
        return {"sound": {"file": os.path.relpath(file, self.folder), "start": round(seconds, 6), **facts}}

    def _is_under_its_picture(self, sound: Any) -> bool:
        """Tell whether the sound of a shot is heard at the frame of the shot at which the shot has it.

        Where clips dissolve, it begins before its clip: the frames beyond the cut are counted on.
        """
        facts, rate = _facts(sound), float(self._rate.fps)
        in_shot = sound.trimmed_range().start_time.to_seconds() + float(facts["start"])
        expected = float(facts["first_frame"]) / rate + in_shot
        for clip in self._pictures.find_clips():
            if clip.effects or clip.name != facts["shot"]:
                continue
            seen = clip.trimmed_range().start_time.to_seconds() + _begin(sound) - _begin(clip)
            if abs(seen - expected) < 0.5 / rate:
                return True
        return False

    def _refused(self, fault: str) -> ShotError:
        return ShotError(f"{shown(self.file)}: {fault}")


def _facts(clip: Any) -> Mapping[str, Any]:
    """Return what our export wrote with the sound of a clip; nothing for clips of other programs."""
    found = clip.metadata.get("flowsculpt", {})
    return found if isinstance(found, Mapping) else {}


def _begin(clip: Any) -> float:
    """Return the second of the film at which a clip begins, without what dissolves before it."""
    return float(clip.range_in_parent().start_time.to_seconds())
