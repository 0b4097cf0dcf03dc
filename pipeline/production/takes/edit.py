"""The edit: what a film shows, frame by frame, between its title and its credits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.frames import FrameRate
from pipeline.production.files import layout
from pipeline.production.takes.keys import MOVIE_CODE, Key, code_key, key_of
from pipeline.production.takes.window import base_of

if TYPE_CHECKING:
    from pipeline.shot import Film


def movie_bits(quality_name: str) -> int:
    """Bits a sample: 10 where gradients must stay smooth, 8 where everything must play it."""
    return 10 if base_of(quality_name) == "final" else 8


@dataclass(frozen=True)
class Cut:
    """A film's name, cards and rate; its shots are the plan's takes, in order. Lengths in frames."""

    name: str
    title: str
    subtitle: str
    credits: tuple[str, ...]
    title_frames: int
    credits_frames: int
    rate: str

    @classmethod
    def of(cls, film: Film, name: str) -> Cut:
        """`name` is what its file is called."""

        def frames(seconds: float) -> int:
            return round(seconds * float(film.rate.fps))

        return cls(
            name=name,
            title=film.title,
            subtitle=film.subtitle,
            credits=film.credits,
            title_frames=frames(film.title_seconds) if film.title else 0,
            credits_frames=frames(film.credits_seconds) if film.credits else 0,
            rate=str(film.rate),
        )

    def as_data(self) -> dict[str, Any]:
        return {**asdict(self), "credits": list(self.credits)}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Cut:
        return cls(**{**data, "credits": tuple(data["credits"])})

    @property
    def frame_rate(self) -> FrameRate:
        return FrameRate.of(self.rate)

    def length(self, shots: int) -> int:
        """Frames of the whole film, whose shots have so many together."""
        return self.title_frames + shots + self.credits_frames

    def path(self, quality_name: str) -> Path:
        return layout.film(quality_name, self.name)

    def key(self, quality_name: str, frame_keys: Sequence[Key], shown_as: Sequence[Any]) -> Key:
        """Of all that its file holds; what it is called is not in it.

        shown_as  of each shot, what is between its light and the picture
        """
        shown = {name: value for name, value in self.as_data().items() if name != "name"}
        return key_of(
            "film",
            code_key(MOVIE_CODE, ("av", "imageio", "OpenImageIO")),
            shown,
            list(frame_keys),
            list(shown_as),
            movie_bits(quality_name),
        )
