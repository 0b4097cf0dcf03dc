"""The edit of a film: what it shows, frame by frame, between its title and its credits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.production.request.audio import AudioClip, AudioTrack, sound_of_frames
from flowsculpt.pipeline.production.request.lookup import movie_bits
from flowsculpt.pipeline.production.request.manifest import ShotManifest
from flowsculpt.pipeline.production.request.shot_source import PlanningCache, spare_modules
from flowsculpt.pipeline.production.stages import FILM
from flowsculpt.pipeline.production.store import paths
from flowsculpt.pipeline.production.store.store import Key, key_of
from flowsculpt.pipeline.shot.yaml.named_files import text_of
from flowsculpt.render.base.serialise import OMIT_DEFAULT, to_plain
from flowsculpt.render.graphics.title_card import PLAIN, CardStyle, TitleCard

T = TypeVar("T")

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.keys import FrameKeys
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.pipeline.shot import Film
    from flowsculpt.render.graphics.cards import Screen
    from flowsculpt.render.movie.movie_frames import Frame


@dataclass(frozen=True)
class EditItem:
    """A clip or a card in its place in a film.

    clip      index of its shot among the film's clips; None for a card
    frames    its length, with the frames that dissolve
    dissolve  frames over which it comes through the item before
    first     the film's frame, from 0, where the words of a card appear over pictures; else 0
    """

    clip: int | None
    frames: int
    dissolve: int = 0
    title: str = ""
    subtitle: str = ""
    style: CardStyle = field(default=PLAIN, metadata=OMIT_DEFAULT)
    first: int = field(default=0, metadata=OMIT_DEFAULT)

    @property
    def card(self) -> TitleCard:
        return TitleCard(self.title, self.subtitle, self.style)


@dataclass(frozen=True)
class Edit:
    """Name, items, rate and sound of a film; the shots of its clips are the plan's, in order.

    audio    the film's own sound, in place of those of its shots
    clips    the sounds of its shots, if it has none of its own
    setting  gives its shots the shape of its pictures, in place of their own; empty if it has none
    over     cards whose words lie over pictures, in order
    """

    name: str
    items: tuple[EditItem, ...]
    rate: str
    audio: AudioTrack | None = None
    clips: tuple[AudioClip, ...] = ()
    setting: str = ""
    over: tuple[EditItem, ...] = ()

    @classmethod
    def of(cls, film: Film, name: str) -> Edit:
        """Return the edit of a film file; the movie is called `name`."""
        from flowsculpt.pipeline.shot.shot import Clip

        items, over, clips, at = list[EditItem](), list[EditItem](), count(), 0
        for entry in film.entries:
            if isinstance(entry, Clip):
                item = EditItem(next(clips), entry.length(film.rate), entry.dissolve)
            else:
                words = entry.title, entry.subtitle, entry.style
                item = EditItem(None, entry.shown(film.rate), entry.dissolve, *words)
                if entry.style.over:
                    over.append(replace(item, first=max(at, *(each.first + each.frames for each in over), 0)))
                    continue
            items.append(item)
            at += item.frames - item.dissolve
        for place in reversed(range(len(over))):  # the last words end with the film
            at = min(over[place].first, at - over[place].frames)
            over[place] = replace(over[place], first=at)
        audio = None if film.sound is None else AudioTrack.of(film.sound)
        edit = cls(name, tuple(items), str(film.rate), audio, (), film.setting, tuple(over))
        return edit if audio else replace(edit, clips=tuple(edit._sounds_of_shots(film)))

    def _sounds_of_shots(self, film: Film) -> Iterator[AudioClip]:
        """Yield the sounds of the film's clips where they stand, with their dissolves."""
        first = 0
        for item, after in zip(self.items, (*self.items[1:], None), strict=True):
            first -= item.dissolve
            if item.clip is not None:
                clip = film.clips[item.clip]
                tracks, frames = tuple(map(AudioTrack.of, clip.shot.sounds)), clip.frames.numbers
                for sound in sound_of_frames(tracks, clip.shot.frames.numbers, frames, first):
                    yield replace(sound, rise=item.dissolve, fall=after.dissolve if after else 0)
            first += item.frames

    @property
    def sounds(self) -> tuple[AudioClip, ...]:
        """All that is heard: its own sound, or those of its shots."""
        return self.clips if self.audio is None else (AudioClip((self.audio,), 0, self.length),)

    @property
    def frame_rate(self) -> FrameRate:
        return FrameRate.of(self.rate)

    @property
    def length(self) -> int:
        """Frames of the whole film; those of dissolves count once."""
        return sum(item.frames - item.dissolve for item in self.items)

    def frames(
        self,
        screen: Screen,
        shown: Callable[[int], Iterator[T]],
        card: Callable[[Frame], T],
        mix: Callable[[T, T, Any], T] | None = None,
    ) -> Iterator[T]:
        """Yield the frames of the film: clips and cards one after another, mixed where they dissolve.

        screen  where cards stand in the pictures
        shown   yields the frames of the clip in a place
        card    turns a card's frame, uint16 (H, W, 3), into one of these
        mix     mixes two of them by the weight of the second, or weights (H, W, 1); by default `mix_frames`
        """
        from flowsculpt.render.graphics.cards import card_frames, with_words_over  # numba: not for planning
        from flowsculpt.render.movie.movie_frames import dissolve, mix_frames

        def frames(item: EditItem) -> Iterator[T]:
            if item.clip is not None:
                return shown(item.clip)
            return map(card, card_frames(item.card, screen, item.frames))

        mixing: Any = mix or mix_frames
        pictures = dissolve([(item.frames, item.dissolve, frames(item)) for item in self.items], mixing)
        words = [(item.first, item.frames, item.card) for item in self.over]
        return with_words_over(pictures, words, screen, card, mixing) if words else pictures

    def path(self, quality_name: str) -> Path:
        return paths.film(quality_name, self.name)

    def key(self, requests: Sequence[RenderRequest], keys: Sequence[Mapping[int, FrameKeys]]) -> Key:
        """Return the key of the film's movie, whatever its name, by `keys` of its clips' frames."""
        frames = [known[n].frame for clip, known in zip(requests, keys, strict=True) for n in clip.requested]
        shown_as = [request.manifest.shown_as for request in requests]
        audio: Any = None if self.audio is None else self.audio.content
        if self.clips:
            audio = [clip.content for clip in self.clips]
        bits = movie_bits(requests[0].quality_name)
        shown = to_plain(self.items) + to_plain(self.over)
        return key_of(FILM.recipe, shown, self.rate, audio, frames, shown_as, bits)


ManifestOf = Callable[[Path, Edit], ShotManifest]
"""Returns the manifest of a shot in an edit."""


@dataclass(frozen=True)
class ResolvedEdit:
    """An edit with its shots looked up.

    clips  for each clip the path of its shot file and the frames that it shows
    shots  for each clip the frames, the rate, the sounds, the projection and the size of its shot: all that
           an edit needs of it
    """

    edit: Edit
    clips: tuple[tuple[Path, tuple[int, ...]], ...]
    shots: tuple[tuple[tuple[int, ...], str, tuple[AudioTrack, ...], tuple[str, float], tuple[int, int]], ...]

    @classmethod
    def of(cls, film: Film, name: str) -> ResolvedEdit:
        clips = [(clip.shot.path, clip.frames.numbers) for clip in film.clips]
        shots = [
            (
                shot.frames.numbers,
                str(shot.rate),
                tuple(map(AudioTrack.of, shot.sounds)),
                astuple(shot.picture.camera.projection),
                shot.picture.qualities["final"].rendered_size,
            )
            for shot in film.shots
        ]
        absolute = tuple((path.absolute(), frames) for path, frames in clips if path is not None)
        return cls(Edit.of(film, name), absolute, tuple(shots))

    def is_current(self, manifest_of: ManifestOf) -> bool:
        """Tell whether shots and sound are as they were. Raises what reading a shot raises."""
        manifests = (manifest_of(path, self.edit) for path, _ in self.clips)
        same = all(
            (each.frames, each.rate, each.sounds, each.projection, each.size) == shot
            for each, shot in zip(manifests, self.shots, strict=True)
        )
        return same and (self.edit.audio is None or self.edit.audio.is_unchanged)


def resolve_edit(
    path: Path, settings: tuple[str, ...], cache: PlanningCache, manifest_of: ManifestOf
) -> ResolvedEdit:
    """Return the edit at `path`, with settings in its shots; the cache spares reading all of them.

    Raises what `read_film` raises.
    """
    text = None
    with suppress(FlowsculptError):  # `read_film` tells why it cannot be read
        text = text_of(path)
    found_from = "film", text, str(path.absolute()), settings
    known = cache.get(ResolvedEdit, *found_from)
    if known is not None:
        with suppress(FlowsculptError):  # reading the film tells all that is wrong
            if known.is_current(manifest_of):
                return known
    from flowsculpt.pipeline.shot import read_film

    spare_modules()
    resolved = ResolvedEdit.of(read_film(path, settings, text), path.stem)
    cache.put(resolved, *found_from)
    return resolved
