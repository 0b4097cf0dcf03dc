"""The edit of a film: what it shows, frame by frame, between its title and its credits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FlowsculptError, FrameError
from pipeline.frames import FrameRate
from pipeline.production.request.crop_and_scale import movie_bits
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.request.shot_source import ShotSummary
from pipeline.production.stages import FILM
from pipeline.production.store import paths
from pipeline.production.store.store import Key, key_of
from pipeline.shot.yaml.lookup import text_of
from render.base.input_files import digest_of_file
from render.base.serialise import from_plain, to_plain

if TYPE_CHECKING:
    from pipeline.production.request.keys import FrameKeys
    from pipeline.production.request.render_request import RenderRequest
    from pipeline.shot import Film
    from pipeline.shot.shot import Card, Clip
    from render.movie.sound import Sound


@dataclass(frozen=True)
class EditItem:
    """A clip or a card in its place in a film.

    clip      index of its shot among the film's clips; None for a card
    frames    its length, with the frames that dissolve
    dissolve  frames over which it comes through the item before
    """

    clip: int | None
    frames: int
    dissolve: int = 0
    title: str = ""
    subtitle: str = ""


@dataclass(frozen=True)
class AudioTrack:
    """The sound of a film: a file as it was when the film was planned, and how it lies in the film.

    start    seconds into the film; below 0 its beginning is left out
    gain     decibels
    fade_in, fade_out  seconds
    """

    file: str
    digest: str
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0

    @property
    def content(self) -> dict[str, Any]:
        """All that decides the sound, which the place of the file does not."""
        return {name: value for name, value in asdict(self).items() if name != "file"}

    @property
    def is_unchanged(self) -> bool:
        path = Path(self.file)
        return path.is_file() and digest_of_file(path) == self.digest

    def sound(self) -> Sound:
        """Return the sound. Raises FrameError where the file was changed."""
        from render.movie.sound import Sound

        path = Path(self.file)
        if not self.is_unchanged:
            raise FrameError(f"{path} was changed while the film was made; run again")
        return Sound(path, self.start, self.gain, self.fade_in, self.fade_out)


@dataclass(frozen=True)
class Edit:
    """Name, items, rate and sound of a film; the shots of its clips are the plan's, in order."""

    name: str
    items: tuple[EditItem, ...]
    rate: str
    audio: AudioTrack | None = None

    @classmethod
    def of(cls, film: Film, name: str) -> Edit:
        """Return the edit of a film file; the movie is called `name`."""
        from pipeline.shot.shot import Card, Clip

        clips = count()

        def item(entry: Clip | Card) -> EditItem:
            frames = entry.length(film.rate)
            if isinstance(entry, Clip):
                return EditItem(next(clips), frames, entry.dissolve)
            return EditItem(None, frames, entry.dissolve, entry.title, entry.subtitle)

        first, *others = film.credits or ("",)
        title = Card(film.title, film.subtitle, film.title_seconds if film.title else 0.0)
        credits = Card(first, " · ".join(others), film.credits_seconds if film.credits else 0.0)
        items = [item(entry) for entry in (title, *film.entries, credits)]
        sound = film.sound
        audio = None if sound is None else AudioTrack(**{**vars(sound), "file": str(sound.file)})
        return cls(name, tuple(item for item in items if item.frames), str(film.rate), audio)

    @property
    def frame_rate(self) -> FrameRate:
        return FrameRate.of(self.rate)

    @property
    def length(self) -> int:
        """Frames of the whole film; those of dissolves count once."""
        return sum(item.frames - item.dissolve for item in self.items)

    def path(self, quality_name: str) -> Path:
        return paths.film(quality_name, self.name)

    def key(self, requests: Sequence[RenderRequest], keys: Sequence[Mapping[int, FrameKeys]]) -> Key:
        """Return the key of the film's movie, whatever its name, by `keys` of its clips' frames."""
        frames = [known[n].frame for clip, known in zip(requests, keys, strict=True) for n in clip.requested]
        shown_as = [request.shown_as for request in requests]
        audio = None if self.audio is None else self.audio.content
        bits = movie_bits(requests[0].quality_name)
        return key_of(FILM.recipe, to_plain(self.items), self.rate, audio, frames, shown_as, bits)


@dataclass(frozen=True)
class ResolvedEdit:
    """An edit with its shots looked up.

    clips  for each clip the path of its shot file and the frames that it shows
    shots  for each clip the frames and the rate of its shot: all that an edit needs of it
    """

    edit: Edit
    clips: tuple[tuple[Path, tuple[int, ...]], ...]
    shots: tuple[tuple[tuple[int, ...], str], ...]

    @classmethod
    def of(cls, film: Film, name: str) -> ResolvedEdit:
        clips = [(clip.shot.path, clip.frames.numbers) for clip in film.clips]
        shots = [(clip.shot.frames.numbers, str(clip.shot.rate)) for clip in film.clips]
        absolute = tuple((path.absolute(), frames) for path, frames in clips if path is not None)
        return cls(Edit.of(film, name), absolute, tuple(shots))

    def is_current(self, summary_of: Callable[[Path], ShotSummary]) -> bool:
        """Tell whether shots and sound are as they were. Raises what reading a shot raises."""
        summaries = (summary_of(path) for path, _ in self.clips)
        same = all((s.frames, s.rate) == shot for s, shot in zip(summaries, self.shots, strict=True))
        return same and (self.edit.audio is None or self.edit.audio.is_unchanged)


def resolved_edit(
    path: Path, settings: tuple[str, ...], cache: PlanningCache, summary_of: Callable[[Path], ShotSummary]
) -> ResolvedEdit:
    """Return the edit at `path`, with settings in its shots; the cache spares reading all of them.

    Raises what `read_film` raises.
    """
    text = None
    with suppress(FlowsculptError):  # `read_film` tells why it cannot be read
        text = text_of(path)
    found_from = "film", text, str(path.absolute()), settings
    known = cache.get(*found_from)
    if known is not None:
        resolved = from_plain(ResolvedEdit, known)
        with suppress(FlowsculptError):  # reading the film tells all that is wrong
            if resolved.is_current(summary_of):
                return resolved
    from pipeline.shot import read_film

    resolved = ResolvedEdit.of(read_film(path, settings, text), path.stem)
    cache.put(to_plain(resolved), *found_from)
    return resolved
