"""Sound in a shot file: values that follow one, and the sound that is heard."""

import re
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from pipeline.flow.keyframes import Envelope, SoundCurve
from pipeline.shot.clock import Clock
from pipeline.shot.documents.field_types import (
    MAPPING_IS_SECOND,
    ByForm,
    Document,
    Real,
    SchemaKeywords,
    Triple,
    is_number,
    one_of,
)
from pipeline.shot.shot import SoundTrack
from pipeline.shot.yaml.document_validation import ParseContext, as_finding, bad_value
from pipeline.shot.yaml.plain_text import in_yaml
from render.base.input_files import digest_of_file

BANDS = {"all": (20.0, 20000.0), "bass": (20.0, 250.0), "mid": (250.0, 4000.0), "high": (4000.0, 20000.0)}
"""Bands by name: from and to, Hz."""

NARROWEST = 10.0
"""Width of the narrowest band, in Hz."""

SUFFIXES = (".wav", ".flac", ".aif", ".aiff", ".mp3", ".m4a", ".ogg", ".opus")
"""Usual endings of sound files, for suggestions; any file that FFmpeg reads will do."""


def _require_seconds(value: Any) -> Any:
    """Refuse a duration with a unit, with the seconds that it is."""
    if isinstance(value, str) and (match := re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m?)s\s*", value)):
        seconds = float(match[1]) * (0.001 if match[2] else 1.0)
        raise bad_value(f"{value} has a unit; it is a number of seconds. Write {seconds:g}.")
    return value


Frequency = Annotated[float, Field(ge=0, le=400_000)]
Duration = Annotated[float, BeforeValidator(_require_seconds), Field(ge=0, le=60)]
Seconds = Annotated[float, Field(ge=0, le=86400)]
Start = Annotated[float, Field(ge=-86400, le=86400)]


def _require_band(value: Any) -> Any:
    """Refuse a list that is not a band, with one that is."""
    if not isinstance(value, list) or not all(map(is_number, value)):
        return value
    if len(value) != 2:
        raise bad_value(f"{in_yaml(value)} is not a band; a band is [from, to] in Hz. Write [60, 120].")
    low, high = value
    if low > high:
        raise bad_value(
            f"{in_yaml(value)} is empty; the first frequency must be below the second. Write "
            f"{in_yaml([high, low])}."
        )
    if high - low < NARROWEST:
        wider = [max(0, low - 10), high + 10]
        raise bad_value(
            f"{in_yaml(value)} is {high - low:g} Hz wide; a band must have {NARROWEST:g} Hz or more. Write "
            f"{in_yaml(wider)}."
        )
    return value


Band = Annotated[
    Annotated[str, one_of(BANDS, "band")]
    | Annotated[list[Frequency], SchemaKeywords(minItems=2, maxItems=2)],
    ByForm(lambda value: isinstance(value, list)),
    BeforeValidator(_require_band),
]


class _FollowsSound(Document):
    """A value that follows the level of a sound; see `FromSound`."""

    example = "{audio: music.wav}"

    audio: str = Field(
        description="sound beside this file that it follows: WAV, FLAC, or another format of FFmpeg"
    )
    band: Band = Field("all", description="all, bass, mid, high, or [from, to] (Hz)")
    attack: Duration = Field(0.005, description="it rises by 63 % of a step in this time (s)")
    release: Duration = Field(0.2, description="it falls by 63 % of a step in this time (s)")
    normalise: Annotated[str, one_of(("loudest", "full_scale"), "normalisation")] = Field(
        "loudest", description="the sound of level 1: the loudest moment of the band, or a sine of full scale"
    )
    start: Start = Field(
        0.0, description="when the sound begins in the shot; a negative start cuts its beginning (s)"
    )

    _envelope: Envelope | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _can_be_read(self, info: ValidationInfo) -> Self:
        """Read the sound: the disk cache stores its levels. Without a folder nothing is read."""
        if (info.context or {}).get("parse_context") is not None:
            self._envelope = self._read(ParseContext.of(info), (info.context or {}).get("clock"))
        return self

    def _read(self, context: ParseContext, clock: Clock | None) -> Envelope:
        from render.movie.band_level import band_level  # imports PyAV, which takes time

        path = context.file(self.audio)
        context.sounds.append((path, self.start))
        low, high = BANDS[self.band] if isinstance(self.band, str) else self.band
        level = as_finding(lambda: band_level(path, context.digests[path], low, high))
        envelope = Envelope(
            digest=context.digests[path],
            band=(low, high),
            attack=self.attack,
            release=self.release,
            normalise="full_scale" if self.normalise == "full_scale" else "loudest",
            interval=level.interval,
            levels=tuple(level.levels.tolist()),
        )
        if envelope.is_silent:
            context.notes.append(
                f"{self.audio} is silent from {low:g} to {high:g} Hz, so values of that band stay the same"
            )
        end = self.start + level.seconds
        if clock is not None and end < clock.duration:
            context.notes.append(
                f"{self.audio} ends at {end:.4g} s, and the shot at {clock.duration:.4g} s; from there on "
                "its level is 0"
            )
        return envelope

    def _curve(self, base: list[float], gain: list[float], unit: float) -> SoundCurve:
        assert self._envelope is not None, "a shot file is read with its folder"
        bases, gains = (tuple(unit * value for value in values) for values in (base, gain))
        return SoundCurve(self._envelope, self.start, bases, gains)


class FromSound(_FollowsSound):
    """`{audio: music.wav, band: bass, gain: 60}`: base + gain × the level of the band, from 0 to 1."""

    gain: Real = Field(1.0, description="what the level 1 adds, in the unit of the value")
    base: Real = Field(0.0, description="the value in silence")

    def curve(self, unit: float) -> SoundCurve:
        """Return the curve; `unit` converts the file's unit to the code's."""
        return self._curve([self.base], [self.gain], unit)


class FromSoundTriple(_FollowsSound):
    """`{audio: music.wav, gain: [0, 1, 0]}`: as FromSound, for a vector."""

    example = "{audio: music.wav, gain: [0, 1, 0]}"

    gain: Triple = Field(description="what the level 1 adds along x, y and z, in the unit of the value")
    base: Triple = Field([0.0, 0.0, 0.0], description="the vector in silence")

    def curve(self, unit: float) -> SoundCurve:
        """Return the curve; `unit` converts the file's unit to the code's."""
        return self._curve(self.base, self.gain, unit)


class SoundDocument(Document):
    """A sound that is heard."""

    example = "{file: music.wav}"

    file: str = Field(description="beside this file: WAV, FLAC, or another format that FFmpeg reads")
    start: Start = Field(0.0, description="when it begins; a negative start cuts its beginning (s)")
    gain: Annotated[float, Field(ge=-60, le=24)] = Field(0.0, description="louder above 0, softer below (dB)")
    fade_in: Seconds = Field(0.0, description="duration of the fade at its beginning (s)")
    fade_out: Seconds = Field(0.0, description="duration of the fade at its end or the pictures' (s)")

    @model_validator(mode="after")
    def _can_be_read(self, info: ValidationInfo) -> Self:
        """Read the sound of a shot; `film_reader` reads that of an edit."""
        if (info.context or {}).get("parse_context") is not None:
            from render.movie.movie_sound import require_sound

            path = ParseContext.of(info).file(self.file)
            as_finding(lambda: require_sound(path))
        return self

    def build(self, folder: Path) -> SoundTrack:
        """Return the sound; its file is relative to `folder`. Raises MissingInputError."""
        file = (folder / self.file).absolute()
        values = self.model_dump(exclude={"file"})
        return SoundTrack(file, digest_of_file(file), **{name: float(v) for name, v in values.items()})


def _require_mapping(value: Any) -> Any:
    """Refuse the name of a file alone, with the mapping that it belongs in."""
    if isinstance(value, str) and value != "off":
        raise bad_value(f"a sound is a mapping, or off. Write {in_yaml({'file': value})}.")
    return value


SoundField = Annotated[
    Annotated[str, one_of(("off",), "sound")] | SoundDocument,
    MAPPING_IS_SECOND,
    BeforeValidator(_require_mapping),
]
"""`{file: music.wav}`, or `off`."""
