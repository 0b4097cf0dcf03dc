"""The layout of film files, which are edits."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from pipeline.shot.documents.fields import Document
from pipeline.shot.documents.shot import Rate

CardSeconds = Annotated[float, Field(ge=0, le=60)]
DissolveFrames = Annotated[int, Field(ge=0, le=1000)]
Seconds = Annotated[float, Field(ge=0, le=86400)]


class ClipDocument(Document):
    """All of a shot, or a part of it."""

    shot: str = Field(description="its name")
    frames: str | None = Field(
        None, description="frames to show, as in 10-40, or 10-40x2 for every second; by default all"
    )
    dissolve: DissolveFrames = Field(
        0, description="length of the dissolve from the entry before; the two overlap (frames)"
    )


class CardDocument(Document):
    """A title card between shots."""

    card: str = Field(description="its words")
    subtitle: str = Field("", description="words below them")
    seconds: Annotated[float, Field(gt=0, le=60)] = Field(2.0, description="its duration (s)")
    dissolve: DissolveFrames = Field(
        0, description="length of the dissolve from the entry before; the two overlap (frames)"
    )


class SoundDocument(Document):
    """The sound of a film."""

    file: str = Field(description="beside this file: WAV, FLAC, or another format that FFmpeg reads")
    start: Annotated[float, Field(ge=-86400, le=86400)] = Field(
        0.0, description="when it begins in the film; a negative start cuts its beginning (s)"
    )
    gain: Annotated[float, Field(ge=-60, le=24)] = Field(0.0, description="louder above 0, softer below (dB)")
    fade_in: Seconds = Field(0.0, description="duration of the fade at its beginning (s)")
    fade_out: Seconds = Field(0.0, description="duration of the fade at its end or the film's (s)")


def _entry_form(value: Any) -> str:
    return ("a card" if "card" in value else "a shot") if isinstance(value, dict) else "by name"


class FilmDocument(Document):
    title: str = Field(description="the name of the film, on its first card")
    subtitle: str = Field("", description="below the title")
    credits: list[str] = Field(default_factory=list, description="lines of the last card")
    shots: list[
        Annotated[
            Annotated[str, Tag("by name")]
            | Annotated[ClipDocument, Tag("a shot")]
            | Annotated[CardDocument, Tag("a card")],
            Discriminator(_entry_form),
        ]
    ] = Field(
        min_length=1, description="names of shot files beside this one, and cards, in the order of the edit"
    )
    sound: SoundDocument | None = Field(None, description="sound from a file beside this one")
    rate: Rate = Field(24, description="24, 23.976 or 24000/1001: the same for all shots (frames per second)")
    title_seconds: CardSeconds = Field(3.0, description="duration of the title; 0 leaves it out (s)")
    credits_seconds: CardSeconds = Field(3.0, description="duration of the credits; 0 leaves them out (s)")
