"""Values of a shot file that may change over time: a constant, keys, a formula, or the level of a sound."""

import math
import re
from abc import abstractmethod
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, Self, TypeVar, cast, get_args

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.errors import UsageError, quote
from flowsculpt.pipeline.flow.easings import HAND_EASES
from flowsculpt.pipeline.flow.keyframes import (
    BEZIER,
    Envelope,
    Extrapolation,
    FormulaCurve,
    Handle,
    Keyframes,
    SoundCurve,
)
from flowsculpt.pipeline.flow.parameters import Curve, Number, Values, VectorParameter
from flowsculpt.pipeline.formula import TIME, Expression, FormulaError
from flowsculpt.pipeline.shot.documents.field_types import (
    MAPPING_IS_SECOND,
    ByForm,
    Document,
    NumberOrText,
    Positive,
    Real,
    SchemaKeywords,
    Triple,
    ZeroToOne,
    formula_over,
    is_number,
    is_written_number,
    one_of,
    optional,
    vector,
)
from flowsculpt.pipeline.shot.motion import TIME_PATTERN, Clock
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml

T = TypeVar("T")

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
        raise ValueError(f"{value} has a unit; it is a number of seconds. Write {seconds:g}.")
    return value


Frequency = Annotated[float, Field(ge=0, le=400_000)]
Duration = Annotated[float, BeforeValidator(_require_seconds), Field(ge=0, le=60)]
Start = Annotated[float, Field(ge=-86400, le=86400)]


def _require_band(value: Any) -> Any:
    """Refuse a list that is not a band, with one that is."""
    if not isinstance(value, list) or not all(map(is_number, value)):
        return value
    low, high = sorted(value) if len(value) == 2 else (60, 120)
    if value != [low, high] or high - low < NARROWEST:
        meant = [low, high] if high - low >= NARROWEST else [max(0, low - 10), high + 10]
        rule = f"a band is [from, to] in Hz, {NARROWEST:g} Hz wide or more"
        raise ValueError(f"{in_yaml(value)} is not a band; {rule}. Write {in_yaml(meant)}.")
    return value


Band = Annotated[
    Annotated[str, one_of(BANDS, "band")]
    | Annotated[list[Frequency], SchemaKeywords(minItems=2, maxItems=2)],
    ByForm(lambda value: isinstance(value, list)),
    BeforeValidator(_require_band),
]


class Changing(Document):
    """A parsed value that changes over time: keys, a formula or the level of a sound."""

    @abstractmethod
    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        """Return the curve over the seconds of a shot; `unit` converts the file's unit to the code's."""


class _FollowsSound(Changing):
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
        from flowsculpt.render.movie.band_level import band_level  # imports PyAV, which takes time

        path = context.file(self.audio)
        low, high = BANDS[self.band] if isinstance(self.band, str) else self.band
        level = band_level(path, context.digests[path], low, high)
        context.sounds.append((self.start, path, level.silence))
        envelope = Envelope(
            digest=context.digests[path],
            band=(low, high),
            attack=self.attack,
            release=self.release,
            normalise="full_scale" if self.normalise == "full_scale" else "loudest",
            interval=level.interval,
            levels=tuple(level.levels.tolist()),
            silence=level.silence,
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

    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        return self._curve([self.base], [self.gain], unit)


class FromSoundTriple(_FollowsSound):
    """`{audio: music.wav, gain: [0, 1, 0]}`: as FromSound, for a vector."""

    example = "{audio: music.wav, gain: [0, 1, 0]}"

    gain: Triple = Field(description="what the level 1 adds along x, y and z, in the unit of the value")
    base: Triple = Field([0.0, 0.0, 0.0], description="the vector in silence")

    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        return self._curve(self.base, self.gain, unit)


MOST_SAMPLES = 4000
"""Most times at which a curve is checked while the shot is read."""

_EASE_NAME = one_of(Keyframes.EASE_NAMES, "easing")


def _check_ease(text: str) -> str:
    """Check the name of an easing; those of heavy things may have their number after it: `settle 0.3`."""
    name, _, number = text.partition(" ")
    if not number or name not in HAND_EASES:
        return _EASE_NAME.func(text)  # type: ignore[call-arg]  # it takes no more
    _, default, least, most = HAND_EASES[name]
    if not re.fullmatch(r"\d+(\.\d+)?", number) or not least <= float(number) <= most:
        rule = f"the number after {name} must be from {least:g} to {most:g}"
        raise ValueError(f"{quote(text)} is not an easing; {rule}. Write {name} {default:g}.")
    return f"{name} {float(number):g}"


Ease = Annotated[
    str,
    AfterValidator(_check_ease),
    SchemaKeywords(
        anyOf=[{"enum": list(Keyframes.EASE_NAMES)}, {"pattern": f"^({'|'.join(HAND_EASES)}) [0-9.]+$"}]
    ),
]
ExtrapolationName = Annotated[str, one_of(get_args(Extrapolation), "extrapolation")]


BezierHandle = Annotated[
    Any,
    SchemaKeywords(
        type=["array", "null"],
        prefixItems=[{"type": ["number", "string"]}, {"type": ["number", "array"]}],
        minItems=2,
        maxItems=2,
    ),
]
"""[time, value] away from a key; `motion_checks.check_keys` checks its form."""


class KeyDocument(Document, Generic[T]):
    """One key with an easing of its own, for the segment from it to the next, and Bézier handles."""

    value: T = Field(description="the value at this key")
    ease: Ease | None = optional("interpolation from here to the next key")
    left: BezierHandle = optional("handle of a bezier segment: [time, value] from the key, time negative")
    right: BezierHandle = optional("handle of a bezier segment: [time, value] from the key")


KeyValue = Annotated[T | KeyDocument[T], MAPPING_IS_SECOND]


class Keyed(Changing, Generic[T]):
    """`{ease: sine_in_out, keys: {1: 0, 20: 4}, after: loop}`; `check_keys` checks the times."""

    keys: Annotated[dict[Any, KeyValue[T]], SchemaKeywords(propertyNames={"pattern": TIME_PATTERN})] = Field(
        min_length=1, description="values by their times: frames, or seconds as 0.5s"
    )
    ease: Ease = Field("sine_in_out", description="interpolation from each key to the next")
    before: ExtrapolationName = Field("hold", description="values before the first key")
    after: ExtrapolationName = Field("hold", description="values after the last key")

    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        def values(item: Any) -> Values:
            return tuple(unit * float(part) for part in (item if isinstance(item, list) else [item]))

        def handle(offset: list[Any] | None) -> Handle | None:
            if offset is None:
                return None
            return Handle(known_seconds(clock.length(offset[0])), values(offset[1]))

        items = self.keys.values()
        keys = [item if isinstance(item, KeyDocument) else KeyDocument(value=item) for item in items]
        with_handles = any(key.left or key.right for key in keys)
        return Keyframes(
            tuple(known_seconds(clock.seconds(time)) for time in self.keys),
            tuple(values(key.value) for key in keys),
            tuple(key.ease or (BEZIER if key.right else self.ease) for key in keys),
            tuple(handle(key.left) for key in keys) if with_handles else (),
            tuple(handle(key.right) for key in keys) if with_handles else (),
            cast(Extrapolation, self.before),
            cast(Extrapolation, self.after),
        )


FormulaText = Annotated[NumberOrText, formula_over(TIME)]


class OverTime(Changing):
    """`{formula: 4 * sin(2 * pi * t)}`"""

    formula: FormulaText = Field(description="over frame and t, seconds")

    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        return FormulaCurve((self.formula,), float(clock.rate.fps), clock.frames.first, unit)


class OverTimeTriple(Changing):
    """`{formula: [cos(t), 0, sin(t)]}`"""

    formula: Annotated[list[FormulaText], Field(min_length=3, max_length=3)] = Field(
        description="three formulas over frame and t, seconds"
    )

    def curve(self, clock: Clock, unit: float = 1.0) -> Curve:
        return FormulaCurve(tuple(self.formula), float(clock.rate.fps), clock.frames.first, unit)


class Bounds(NamedTuple):
    """The range of a value, and the rule as a message says it."""

    low: float
    high: float
    rule: str


ANYWHERE = Bounds(-math.inf, math.inf, "")
ABOVE_0 = Bounds(math.ulp(0.0), math.inf, "above 0")
NOT_BELOW_0 = Bounds(0.0, math.inf, "at 0 or above")
FROM_0_TO_1 = Bounds(-1e-12, 1.0 + 1e-12, "from 0 to 1")


def within(bounds: Bounds) -> AfterValidator:
    """Return a validator: over the course of the shot a curve stays finite and within bounds.

    The clock stands in the context of the validation; without one nothing is checked.
    """

    def check(value: Any, info: ValidationInfo) -> Any:
        clock: Clock | None = (info.context or {}).get("clock")
        if clock is None or not isinstance(value, Changing):
            return value
        fault = _curve_fault(value, clock, bounds)
        if fault:
            raise ValueError(fault)
        return value

    return AfterValidator(check)


def sampled_frames(clock: Clock) -> list[float]:
    """Return the half frames at which curves are checked: all of them, or MOST_SAMPLES of a long shot."""
    halves = 2 * (clock.frames.last - clock.frames.first) + 1
    return [clock.frames.first + i / 2 for i in range(0, halves, -(-halves // MOST_SAMPLES))]


def _curve_fault(value: Changing, clock: Clock, bounds: Bounds) -> str | None:
    """Return the message about the first half frame at which a curve is out of bounds or not finite."""
    if isinstance(value, Keyed) and (bounds is ANYWHERE or None in map(clock.seconds, value.keys)):
        return None
    curve = value.curve(clock)
    if isinstance(curve, SoundCurve):
        times = curve.times(clock.duration)
    else:
        times = [clock.time(frame) for frame in sampled_frames(clock)]
    try:
        rows = curve.over(times).tolist() if isinstance(curve, FormulaCurve) else map(curve.at, times)
        for time, row in zip(times, rows, strict=True):
            worst = min(row) if min(row) < bounds.low else max(row)
            if not bounds.low <= worst <= bounds.high:
                frame = clock.frames.first + float(clock.rate.fps) * time
                return f"{worst:.4g} at frame {frame:g} is out of range; it must stay {bounds.rule}"
    except UsageError as error:
        return f"not finite: {error}"
    return None


NotNegative = Annotated[Real, Field(ge=0)]


def curve_form(value: Any) -> int:
    """Return which member of a union a value is: 0 a constant, 1 keys, 2 a formula, 3 a sound."""
    return 0 if not isinstance(value, dict) else 2 if "formula" in value else 3 if "audio" in value else 1


CURVE = ByForm(curve_form)


def _require_form(value: Any) -> Any:
    """Refuse what is meant as keys, as a formula or as a place, with the form that it must have."""
    if isinstance(value, dict):
        if value and all(_is_time(name) for name in value):
            raise ValueError(f"frames stand under keys. Write {{keys: {in_yaml(value)}}}.")
        if isinstance(keys := value.get("keys"), list):
            raise ValueError(f"keys are values by their frames. Write keys: {_by_frame(keys)}.")
        if {"x", "y", "z"} == set(value):
            raise ValueError(f"a place is a list. Write {in_yaml([value[name] for name in 'xyz'])}.")
        sound = next((value[word] for word in _SOUND_WORDS if isinstance(value.get(word), str)), None)
        if sound is not None and not {"keys", "formula", "audio"} & value.keys():
            raise ValueError(f"a value that follows a sound has audio. Write {{audio: {sound}}}.")
    elif isinstance(value, str) and Path(value).suffix.lower() in SUFFIXES:
        raise ValueError(f"a value that follows a sound is a mapping. Write {{audio: {value}}}.")
    elif isinstance(value, str) and not is_written_number(value) and _is_formula(value):
        raise ValueError(f"{quote(value)} is a formula. Write {{formula: {value}}}.")
    return value


def _is_time(name: Any) -> bool:
    return is_number(name) or (isinstance(name, str) and bool(re.match(TIME_PATTERN, name)))


def _is_formula(text: str) -> bool:
    try:
        Expression(text, TIME)
    except FormulaError:
        return False
    return True


def _by_frame(keys: list[Any]) -> str:
    """Return a list of keys as a mapping: pairs of frame and value, or values alone."""
    if all(isinstance(key, list) and len(key) == 2 and is_number(key[0]) for key in keys):
        return in_yaml({key[0]: key[1] for key in keys})
    return f"{{1: {in_yaml(keys[0])}, …}}" if keys else "{1: 0, 24: 1}"


_SOUND_WORDS = ("sound", "file", "music")
"""Words for the file of a sound in other places."""

CURVE_FORM = BeforeValidator(_require_form)

NumberField = Annotated[Real | Keyed[Real] | OverTime | FromSound, CURVE, within(ANYWHERE), CURVE_FORM]
"""A number that may change over time: a constant, or a `Changing` value."""

PositiveField = Annotated[
    Positive | Keyed[Positive] | OverTime | FromSound, CURVE, within(ABOVE_0), CURVE_FORM
]
NotNegativeField = Annotated[
    NotNegative | Keyed[NotNegative] | OverTime | FromSound, CURVE, within(NOT_BELOW_0), CURVE_FORM
]
WeightField = Annotated[
    ZeroToOne | Keyed[ZeroToOne] | OverTime | FromSound, CURVE, within(FROM_0_TO_1), CURVE_FORM
]
"""A number from 0 to 1 that may change over time: a constant, or a `Changing` value."""

PlaceField = Annotated[
    Triple | Keyed[Triple] | OverTimeTriple | FromSoundTriple, CURVE, within(ANYWHERE), CURVE_FORM
]


def number(parameter: float | Keyed[Any] | OverTime | FromSound, clock: Clock, unit: float = 1.0) -> Number:
    """Return a parsed scalar as flows take it; `unit` converts the file's unit to the code's."""
    if isinstance(parameter, Changing):
        return parameter.curve(clock, unit)
    return float(parameter) * unit


def place(
    parameter: list[float] | Keyed[Any] | OverTimeTriple | FromSoundTriple, clock: Clock, unit: float = 1.0
) -> VectorParameter:
    """Return a parsed vector as flows take it."""
    if isinstance(parameter, Changing):
        return parameter.curve(clock, unit)
    x, y, z = vector(parameter)
    return unit * x, unit * y, unit * z


def known_seconds(seconds: float | None) -> float:
    """Return a time that checks have accepted."""
    assert seconds is not None, "checks have refused everything that is not a time"
    return seconds
