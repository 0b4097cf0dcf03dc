"""The edit: what a film shows, frame by frame, between its title and its credits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate, count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FrameError
from pipeline.frames import FrameRate
from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import FILM
from pipeline.production.request.crop_and_scale import base_of
from pipeline.production.store import paths
from pipeline.shot.yaml.lookup import digest_of_file

if TYPE_CHECKING:
    from pipeline.shot import Film
    from pipeline.shot.shot import Card, Clip
    from render.movie.sound import Sound


def movie_bits(quality_name: str) -> int:
    """Bits a sample: 10 where gradients must stay smooth, 8 where everything must play it."""
    return 10 if base_of(quality_name) == "final" else 8


@dataclass(frozen=True)
class EditItem:
    """A clip or a card of a film, in its place.

    clip      the place of its take among the film's; None of a card
    frames    how many it has, those that dissolve included
    dissolve  over how many of them it comes through the piece before
    """

    clip: int | None
    frames: int
    dissolve: int = 0
    title: str = ""
    subtitle: str = ""


@dataclass(frozen=True)
class AudioTrack:
    """The sound of a film: its file as it was when the film was planned, and how it lies in the film."""

    file: str
    digest: str
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0

    @property
    def content(self) -> dict[str, Any]:
        """All that decides what is heard, which where the file lies does not."""
        return {name: value for name, value in asdict(self).items() if name != "file"}

    @property
    def is_unchanged(self) -> bool:
        """Whether the file is what it was."""
        path = Path(self.file)
        return path.is_file() and digest_of_file(path) == self.digest

    def sound(self) -> Sound:
        """Raises FrameError where the file is not what it was."""
        from render.movie.sound import Sound

        path = Path(self.file)
        if not self.is_unchanged:
            raise FrameError(f"{path} was changed while the film was made; run again")
        return Sound(path, self.start, self.gain, self.fade_in, self.fade_out)


@dataclass(frozen=True)
class Edit:
    """A film's name, pieces, sound and rate; its shots are the plan's takes, in order."""

    name: str
    pieces: tuple[EditItem, ...]
    rate: str
    audio: AudioTrack | None = None

    @classmethod
    def of(cls, film: Film, name: str) -> Edit:
        """`name` is what its file is called."""
        from pipeline.shot.shot import Card, Clip

        clips = count()

        def piece(entry: Clip | Card) -> EditItem:
            frames = entry.length(film.rate)
            if isinstance(entry, Clip):
                return EditItem(next(clips), frames, entry.dissolve)
            return EditItem(None, frames, entry.dissolve, entry.title, entry.subtitle)

        first, *others = film.credits or ("",)
        title = Card(film.title, film.subtitle, film.title_seconds if film.title else 0.0)
        credits = Card(first, " · ".join(others), film.credits_seconds if film.credits else 0.0)
        pieces = [piece(entry) for entry in (title, *film.entries, credits)]
        track = film.sound
        audio = None if track is None else AudioTrack(**{**vars(track), "file": str(track.file)})
        return cls(name, tuple(piece for piece in pieces if piece.frames), str(film.rate), audio)

    def as_data(self) -> dict[str, Any]:
        audio = None if self.audio is None else asdict(self.audio)
        pieces = [asdict(piece) for piece in self.pieces]
        return {"name": self.name, "pieces": pieces, "rate": self.rate, "heard": audio}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Edit:
        audio = None if data["heard"] is None else AudioTrack(**data["heard"])
        return cls(data["name"], tuple(EditItem(**piece) for piece in data["pieces"]), data["rate"], audio)

    @property
    def frame_rate(self) -> FrameRate:
        return FrameRate.of(self.rate)

    @property
    def length(self) -> int:
        """Frames of the whole film; those of dissolves count once."""
        return sum(piece.frames - piece.dissolve for piece in self.pieces)

    @property
    def firsts(self) -> tuple[int, ...]:
        """Of each piece, how many frames of the film come before its first."""
        lengths = (piece.frames - following.dissolve for piece, following in pairwise(self.pieces))
        return tuple(accumulate(lengths, initial=0))

    def path(self, quality_name: str) -> Path:
        return paths.film(quality_name, self.name)

    def key(self, quality_name: str, frame_keys: Sequence[Key], shown_as: Sequence[Any]) -> Key:
        """Of all that its file holds; what it is called is not in it.

        shown_as  of each shot, what is between its light and the picture
        """
        return key_of(
            FILM.recipe,
            [asdict(piece) for piece in self.pieces],
            self.rate,
            None if self.audio is None else self.audio.content,
            list(frame_keys),
            list(shown_as),
            movie_bits(quality_name),
        )
