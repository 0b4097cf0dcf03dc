"""The layout of film files, which are edits."""

import math
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from pipeline.shot.documents.fields import ByForm, Document, optional
from pipeline.shot.documents.picture_shape import PictureShapeDocument
from pipeline.shot.documents.shot import Rate, require_range
from pipeline.shot.documents.sound import SoundDocument
from pipeline.shot.yaml.messages import number_in
from pipeline.shot.yaml.plain_text import in_yaml
from pipeline.shot.yaml.synonyms import synonym
from pipeline.shot.yaml.validation import bad_value, finding

CardSeconds = Annotated[float, Field(ge=0, le=60)]


def _frame_count(value: Any) -> Any:
    """Refuse seconds, with the frames that they are."""
    seconds = float(value) if isinstance(value, float) else None
    if isinstance(value, str) and value.endswith("s"):
        seconds = number_in(value)
    if seconds and math.isfinite(seconds):
        raise bad_value(
            f"{value} is no count of frames. Write {round(24 * seconds)} for {seconds:g} s at 24 a second."
        )
    return value


DissolveFrames = Annotated[int, BeforeValidator(_frame_count), Field(ge=0, le=1000)]


ClipFrames = Annotated[str, BeforeValidator(require_range)]


class ClipDocument(Document):
    """All of a shot, or a part of it."""

    @model_validator(mode="before")
    @classmethod
    def _names_a_shot(cls, value: Any) -> Any:
        """Refuse `A010: 1-24`, with the names that belong there."""
        name = next(iter(value)) if isinstance(value, dict) and len(value) == 1 else None
        known = (*cls.model_fields, *CardDocument.model_fields)
        if isinstance(value, dict) and value and value.keys() <= {"frames", "dissolve"}:
            raise finding(
                f"{' and '.join(value)} {'stands' if len(value) == 1 else 'stand'} beside the shot. "
                f"Write {in_yaml({'shot': 'NAME', **value})}."
            )
        if name is not None and name not in known and synonym(name, known) is None:
            part = f", frames: {value[name]}" if isinstance(value[name], str) else ""
            raise finding(f"{name} has no name before it. Write {{shot: {name}{part}}}.")
        return value

    shot: str = Field(description="its name")
    frames: ClipFrames | None = optional(
        "frames to show, as in 10-40, or 10-40x2 for every second; by default all"
    )
    dissolve: DissolveFrames = Field(0, description="overlap with the entry before (frames)")


class CardDocument(Document):
    """A title card between shots."""

    card: str = Field(description="its words")
    subtitle: str = Field("", description="words below them")
    seconds: Annotated[float, Field(gt=0, le=60)] = Field(2.0, description="its duration (s)")
    dissolve: DissolveFrames = Field(0, description="overlap with the entry before (frames)")


_ENTRY = ByForm(lambda value: 0 if not isinstance(value, dict) else 2 if "card" in value else 1)


class FilmDocument(Document):
    what = "an edit"

    title: str = Field(description="the name of the film, on its first card")
    subtitle: str = Field("", description="below the title")
    credits: list[str] = Field(default_factory=list, description="lines of the last card")
    shots: list[Annotated[str | ClipDocument | CardDocument, _ENTRY]] = Field(
        min_length=1, description="names of shot files beside this one, and cards, in the order of the edit"
    )
    sound: SoundDocument | None = optional("sound from a file beside this one")
    rate: Rate | None = optional(
        "24, 23.976 or 24000/1001: the same for all shots; by default that of the first (frames per second)"
    )
    picture: PictureShapeDocument | None = optional(
        "the shape of the pictures of all shots, in place of their own; by default they share one"
    )
    title_seconds: CardSeconds = Field(3.0, description="duration of the title; 0 leaves it out (s)")
    credits_seconds: CardSeconds = Field(3.0, description="duration of the credits; 0 leaves them out (s)")
