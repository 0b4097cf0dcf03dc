"""An OpenTimelineIO timeline as an edit: what an editor cut becomes a YAML file that names shots and frames.

It is the reverse of `timeline.py`: of the pictures, clips, dissolves and cards; of the sound, one file, or
those of the shots where these have them. What an edit cannot say, such as two pictures on top of each other
or a gap, is refused with its place.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from opentimelineio import adapters, schema
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api import ShotError, shorten, suggest
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.frames import FrameRange, FrameRate
from flowsculpt.pipeline.plugins.delivery.imported_sound import ImportedSound
from flowsculpt.pipeline.plugins.delivery.timeline_times import (
    CARD,
    fault_of,
    frames_in,
    is_on,
    media_offset,
    require_rate,
    span_of,
)

_FIRST_LINE = "# Made from {name} by flowsculpt film --edit, which replaces this file.\n"

_OTHER_TRANSITIONS = re.compile("wipe|push|slide|iris|zoom|dip|additive|swap|spin|peel|flip|morph", re.I)
"""Words in names of transitions that programs call dissolves by their type, and are none."""

_RANGE_IN_NAME = re.compile(r"\.\[?(-?\d+)--?\d+\]?(?:_\w+)?\.")
"""The frames of a shot that a movie has, as `flowsculpt deliver` names it: A010.1-48.prores4444.mov."""


@dataclass(frozen=True)
class ImportedEdit:
    """A timeline to be read as an edit.

    file    the timeline
    shots   names of the shots that its clips may show
    folder  where the edit will lie; files are named relative to it
    frames  of shots whose movies it may show, as their files write them
    """

    file: Path
    shots: Collection[str]
    folder: Path
    frames: Mapping[str, str] = field(default_factory=dict)

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
        entries, faults = self._entries()
        try:
            entries, faults = self._with_titles(entries, faults)
        except UsageError as error:
            raise self._refused(f"its titles: {error}") from None
        if faults:
            raise ShotError(*(f"{self.file}: {fault}" for fault in faults))
        written: dict[str, Any] = {"title": self._timeline.name or self.file.stem, "shots": entries}
        sound = ImportedSound(self._timeline, self._pictures, float(self._rate.fps))
        try:
            written |= sound.setting(self.file.parent, self.folder)
        except UsageError as error:
            raise self._refused(str(error)) from None
        written |= {"rate": str(self._rate), "title_seconds": 0, "credits_seconds": 0}  # it has them as cards
        yaml, stream = YAML(), io.StringIO()
        yaml.width = 100
        yaml.dump(written, stream)
        return first + stream.getvalue()

    @cached_property
    def _timeline(self) -> Any:
        try:
            content = InputFile(self.file).content()
            text = content.decode(json.detect_encoding(content))
            json.loads(text)  # the library's parser has no bound of depth
            found = adapters.read_from_string(text, "otio_json")
        except FlowsculptError:
            raise
        except Exception as error:  # of many kinds, by what the file holds
            reason = "too many brackets" if isinstance(error, RecursionError) else shorten(error)
            fault = f"it cannot be read as OpenTimelineIO ({reason}); export it again"
            raise self._refused(fault) from None
        if not isinstance(found, schema.Timeline):
            kind = found.schema_name() if hasattr(found, "schema_name") else "other JSON"
            raise self._refused(f"it holds no timeline ({kind}); export one")
        return found

    @cached_property
    def _pictures(self) -> Any:
        """The one track of pictures that shows anything."""
        stack = self._timeline.tracks
        for track in stack:
            kind = getattr(track, "kind", type(track).__name__)
            if kind not in ("Video", "Audio") and len(track):
                raise self._refused(f"{shorten(track.name)!r} is a {kind} among its tracks; remove it")
        tracks = [track for track in self._timeline.video_tracks() if any(map(is_on, track.find_clips()))]
        if len(tracks) > 1 and self._titles:
            tracks.remove(self._titles)
        if len(tracks) != 1:
            raise self._refused(
                f"it has {len(tracks)} tracks of pictures that are enabled; an edit has one. Flatten them."
            )
        if fault := fault_of(stack) or fault_of(tracks[0]):
            raise self._refused(fault)
        return tracks[0]

    @cached_property
    def _titles(self) -> Any:
        """The track with nothing but cards, whose words lie over pictures; None where there is none."""
        for track in reversed(self._timeline.video_tracks()):
            clips = list(filter(is_on, track.find_clips()))
            if clips and all(_over_pictures(clip) for clip in clips):
                return track
        return None

    @cached_property
    def _rate(self) -> FrameRate:
        """The rate of the first clip."""
        first = next(filter(is_on, self._pictures.find_clips()))
        try:
            rate = first.trimmed_range().duration.rate
            if not 1 < rate < 1000:  # it counts seconds, or samples
                rate = getattr(first.media_reference, "rate", rate)
            return FrameRate.of(round(float(rate), 3))
        except Exception as error:  # of many kinds, by what it lacks
            raise self._refused(f"clip {shorten(first.name)}: {shorten(error)}") from None

    def _entries(self) -> tuple[list[Any], list[str]]:
        """Return the entries of the edit, and what is wrong."""
        entries: list[Any] = []
        faults: list[str] = []
        parts = [None, *self._pictures, None]
        for index, (before, part, after) in enumerate(zip(parts, parts[1:], parts[2:], strict=False), 1):
            place = f"entry {index} ({shorten(part.name or type(part).__name__)})"
            try:
                if isinstance(part, schema.Transition):
                    self._require_dissolve(before, part, after)
                    continue
                head, tail = self._offset(before, "in_offset"), self._offset(after, "out_offset")
                dissolve = head + self._offset(before, "out_offset")
                entry = self._entry(part, head, tail)
            except UsageError as error:
                faults.append(f"{place}: {error}")
                continue
            entries.append(_in_flow_style(entry | ({"dissolve": dissolve} if dissolve else {})))
        return entries, faults

    def _with_titles(self, entries: list[Any], faults: list[str]) -> tuple[list[Any], list[str]]:
        """Return the entries of the edit with the cards that lie over pictures, and what is wrong.

        Words lie over the beginning of an entry, or over the end of the film.
        """
        if self._titles is None or faults:
            return entries, faults
        begins, at = self._begins()
        placed, first, last = dict[int, list[Any]](), 0, (-1, -1)
        for part in self._titles:
            _, count = span_of(part, self._rate)
            if is_on(part) and isinstance(part, schema.Clip):
                place = len(entries) if first + count == at else begins.get(first)
                place = last[1] if first == last[0] else place  # words after other words over an entry
                if place is None:
                    fact = f"its words begin at frame {first} of the film, within a clip"
                    faults.append(f"title {shorten(part.name)}: {fact}; move them to the beginning of one")
                    continue
                placed.setdefault(place, []).append(_in_flow_style(self._entry(part, 0, 0)))
                last = (first + count, place)
            first += count
        shown = [[*placed.get(place, ()), entry] for place, entry in enumerate(entries)]
        return [*chain(*shown), *placed.get(len(entries), ())], faults

    def _begins(self) -> tuple[dict[int, int], int]:
        """Return the entry that each frame begins, also those of its dissolve, and the length."""
        begins, at, place = dict[int, int](), 0, 0
        parts = list(self._pictures)
        for before, part in zip([None, *parts], parts, strict=False):
            if isinstance(part, schema.Clip):
                dissolve = range(
                    at - self._offset(before, "in_offset"), at + self._offset(before, "out_offset") + 1
                )
                begins |= dict.fromkeys(dissolve, place)
                at, place = at + span_of(part, self._rate)[1], place + 1
        return begins, at

    def _offset(self, part: Any, name: str) -> int:
        if not isinstance(part, schema.Transition):
            return 0
        return frames_in(getattr(part, name), self._rate)

    def _require_dissolve(self, before: Any, part: Any, after: Any) -> None:
        """Raise UsageError for a transition that no edit has."""
        kind, name = part.transition_type, part.name
        if kind != schema.TransitionTypes.SMPTE_Dissolve or _OTHER_TRANSITIONS.search(name):
            raise UsageError(f"it is a transition {shorten(name or kind)!r}; make it a dissolve or a cut")
        if not all(isinstance(each, schema.Clip) for each in (before, after)):
            raise UsageError("it is a dissolve without a clip on both sides; make it a cut")
        if min(self._offset(part, "in_offset"), self._offset(part, "out_offset")) < 0:
            raise UsageError("it has a negative offset; make it a dissolve or a cut")

    def _entry(self, part: Any, head: int, tail: int) -> dict[str, Any]:
        """Return a clip or a card; `head` and `tail` are its frames beyond the cuts, where it dissolves."""
        if not isinstance(part, schema.Clip):
            kind = type(part).__name__
            raise UsageError(f"it is a {kind}, which an edit cannot hold; close it, or show a card")
        if not is_on(part):
            raise UsageError("it is disabled, which leaves a gap; remove it, enable it, or show a card")
        start, count = span_of(part, self._rate)
        reference = part.media_reference
        if isinstance(reference, schema.GeneratorReference):
            given = dict(reference.parameters)
            style = given.pop("style", None)
            words = {name: str(text) for name, text in given.items() if text}
            if "title" not in words and reference.generator_kind != CARD:
                kind = shorten(reference.generator_kind)
                raise UsageError(f"it is a generator {kind!r}; show a card or a shot")
            return {
                "card": words.get("title", part.name or "Card"),
                **({"subtitle": words["subtitle"]} if "subtitle" in words else {}),
                "seconds": round((head + count + tail) / float(self._rate.fps), 6),
                **_style_in_words(style),
            }
        shot, step = self._shot_of(part), self._step(part)
        first = self._first_frame(part, start, shot)
        numbers = [first + step * n for n in range(-head, count + tail)]
        backwards = ",".join(map(str, numbers))  # a range would be in ascending order
        frames = str(FrameRange.of(numbers)) if step > 0 else backwards
        return {"shot": shot, "frames": frames}

    def _first_frame(self, clip: Any, start: int, shot: str) -> int:
        """Return the frame of a shot that a clip begins with; `start` is the frame of its media's time."""
        reference, offset = clip.media_reference, media_offset(clip, self._rate)
        is_sequence = isinstance(reference, schema.ImageSequenceReference)
        if is_sequence:
            require_rate(reference.rate, self._rate)
            if reference.frame_step != 1:
                raise UsageError(f"its media has one file for {reference.frame_step} frames; render all")
        if offset is None:
            if isinstance(reference, schema.MissingReference | None) or (
                is_sequence and reference.start_frame == 0
            ):
                return start
            raise UsageError("its media has no available_range, which says where it begins; export it again")
        if is_sequence:
            return int(reference.start_frame) + offset
        if named := _RANGE_IN_NAME.search(_media_name(reference)):
            return int(named[1]) + offset
        if shot not in self.frames:
            raise UsageError(f"the frames of shot {shot} are unknown; flowsculpt validate {shot} says why")
        frames = FrameRange.parse(self.frames[shot])
        return start if start - offset in frames else frames.first + offset

    def _step(self, clip: Any) -> int:
        """Return the frames from one picture of a clip to the next."""
        effects = [effect for effect in clip.effects if effect.enabled]
        if not effects:
            return 1
        (effect, *more) = effects
        step = float(getattr(effect, "time_scalar", 0.5))
        if more or not step.is_integer() or not 1 <= abs(step) <= 1000:
            raise UsageError("it has an effect other than a whole speed; an edit shows frames as they are")
        return int(step)

    def _shot_of(self, clip: Any) -> str:
        """Return the shot that a clip shows, by that of its media or its own name."""
        reference = clip.media_reference
        names = [getattr(reference, "name_prefix", "").rstrip("._"), _media_name(reference).partition(".")[0]]
        shots = [name for name in (*names, clip.name) if name in self.shots]
        if not shots:
            named = next((name for name in (clip.name, *names) if name), "a clip without a name")
            raise UsageError(f"{named} is not a shot in {self.folder}. {suggest(named, self.shots)}")
        if shots[0] != shots[-1]:
            raise UsageError(f"it is called {shots[-1]} and its media is of {shots[0]}; rename one of them")
        return shots[0]

    def _refused(self, fault: str) -> ShotError:
        return ShotError(f"{self.file}: {fault}")


def _over_pictures(clip: Any) -> bool:
    """Tell whether a clip is a card whose words lie over pictures."""
    reference = clip.media_reference
    is_card = isinstance(reference, schema.GeneratorReference) and reference.generator_kind == CARD
    return is_card and bool(dict(reference.parameters.get("style", {})).get("over"))


def _style_in_words(style: Any) -> dict[str, Any]:
    """Return how a card looks as an edit writes it."""
    given = dict(style or {})
    ground = {"ground": "picture"} if given.pop("over", False) else {}
    for name in given.keys() & {"colour", "ground"}:
        given[name] = "#" + "".join(f"{round(255 * float(value)):02x}" for value in given[name])
    return given | ground


def _in_flow_style(entry: Mapping[str, Any]) -> Any:
    """Return an entry that is written in one line."""
    line = CommentedMap(entry)
    line.fa.set_flow_style()
    return line


def _media_name(reference: Any) -> str:
    """Return the name of a file that a reference has; empty if it has none."""
    return Path(unquote(urlsplit(getattr(reference, "target_url", "") or "").path)).name


def _answer(_path: str, file: str, folder: str, frames: str, *shots: str) -> bytes:
    """Answer the text of an edit, or the name of an error and its messages, as JSON."""
    try:
        answer = [ImportedEdit(Path(file), shots, Path(folder), json.loads(frames)).text(), ""]
    except ShotError as error:
        answer = ["", type(error).__name__, *error.messages]
    except FlowsculptError as error:
        answer = ["", type(error).__name__, str(error)]
    return json.dumps(answer).encode()


if __name__ == "__main__":
    Parser.serve(_answer)
