"""Values of a shot file that an editor shows, and the times of flows that have one of their own."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import (
    PRESETS,
    Changing,
    Clock,
    WrittenShot,
    YamlSource,
    choices,
    field_names,
    is_number,
    members,
)
from flowsculpt.pipeline.plugins.preview.text_edits import Where


def flow_frames(flows: Sequence[Any], subjects: Mapping[str, Any], clock: Clock) -> dict[Where, list[float]]:
    """Return the time of all flows at each frame of the shot, in frames, by the paths of what holds them.

    Of several paths that a flow lies within, the longest tells its time; none where it goes by that of the
    film. Within `repeated`, the time is that of the round.
    """
    first, fps = clock.frames.first, float(clock.rate.fps)
    numbers = range(first, clock.frames.last + 1)
    times = np.array([clock.flow_time(number) for number in numbers])
    lists: dict[Where, Sequence[Any]] = {("flows",): flows}
    for name, subject in subjects.items():
        lists["subjects", name, "flows"] = subject.flows
    found: dict[Where, Floats] = {}
    for where, flows in lists.items():
        if clock.speed != 1.0:
            found[where] = times
        found |= _own_times(flows, where, times, clock)
    return {where: np.round(first + own * fps, 4).tolist() for where, own in found.items()}


def _own_times(
    flows: Sequence[Any], where: Where, times: Floats, clock: Clock
) -> Iterator[tuple[Where, Floats]]:
    """Yield the paths of compositions with a time of their own, and these times (N,), seconds."""
    for index, entry in enumerate(flows):
        name, chosen = next(iter(entry.model_fields_set)), entry.chosen
        place, own = (*where, index, name), times
        if name == "reversed":
            own = (
                clock.duration - times
                if chosen.duration is None
                else _seconds(chosen.duration, clock) - times
            )
        elif name == "repeated":
            own = times % _seconds(chosen.period, clock)
        if own is not times:
            yield place, own
        if isinstance(chosen, list):
            yield from _own_times(chosen, place, own, clock)
        else:
            inner: Any = getattr(chosen, "flows", None)
            yield from _own_times(inner or [], (*place, "flows"), own, clock)


SECTIONS = (
    *("flows", "subject", "subjects", "resample", "camera", "shutter", "look", "lights", "stage", "smooth"),
    "speed",
)
"""Entries of a shot whose values are listed, in the order of the list."""

LEAST_SAMPLES, MOST_SAMPLES = 121, 480
"""Samples of a curve over the shot; two in a frame where that is between them."""


@dataclass(frozen=True)
class SettableValue:
    """One value of a shot as its file has it.

    form         `number`, `whole` (an integer), `vector` (three numbers), `axis` (x, y, z or a vector),
                 `name`, `switch` or `curve` (keys or a formula)
    low, high    bounds of a number; infinite where there are none
    names        what a name can be
    is_given     False for a default, which the file leaves out
    file         name of the file that gives it; empty for the shot's own file and for defaults
    is_vector    True if a curve, or a constant in place of which a curve can stand, has three components
    can_change   True if keys or a formula can stand there
    """

    where: Where
    form: str
    value: Any
    unit: str
    description: str
    low: float
    high: float
    names: tuple[str, ...]
    is_given: bool
    file: str
    can_change: bool
    is_vector: bool
    curve: SampledCurve | None = None


@dataclass(frozen=True)
class SampledCurve:
    """Keys or a formula over the shot.

    frames   (N,) of the samples; where `speed` re-times the flow, frames of the flow's own time
    values   (N, K), three columns for a place
    keys     as the file has them, with `time`, `frame`, `value`, `ease`, `left` and `right`; `is_detailed`
             is True for a mapping, which has an easing or handles
    formula  the text or texts, None for keys
    """

    frames: list[float]
    values: list[list[float]]
    keys: list[dict[str, Any]]
    ease: str
    before: str
    after: str
    formula: Any


class SettableShot(NamedTuple):
    """Values of a shot file that an editor shows, and the times of its flows.

    values       in the order of SECTIONS
    flow_frames  see `flow_frames`
    curves       those that values have, in the units of the file and over seconds of their own time
    """

    clock: Clock
    values: list[SettableValue]
    flow_frames: dict[Where, list[float]]
    curves: dict[Where, Any]

    @property
    def by_path(self) -> dict[Where, SettableValue]:
        """The values by their paths."""
        return {value.where: value for value in self.values}

    def own_frames(self, where: Where) -> list[float]:
        """Return the time by which a value goes at each frame of the shot, in frames."""
        around = [path for path in self.flow_frames if path == where[: len(path)]]
        if around:
            return self.flow_frames[max(around, key=len)]
        return [float(number) for number in range(self.clock.frames.first, self.clock.frames.last + 1)]


def settable_values(path: Path, text: str, settings: tuple[str, ...] = ()) -> SettableShot:
    """Return the clock, the values and the times of flows of a valid shot file.

    Arguments are those of `read_shot`, which reports mistakes; raises pydantic's errors where there are any.
    """
    written = WrittenShot.read(path, text, settings)
    clock = written.clock
    assert clock is not None, "read_shot has accepted the file"
    document = written.document(clock)
    times = flow_frames(document.flows, document.subjects or {}, clock)
    ends = [clock.frames.first, clock.frames.last, *(frame for frames in times.values() for frame in frames)]
    walk = _Walk(written.source, clock, math.floor(min(ends)), math.ceil(max(ends)))
    kinds, fields = field_names([type(document)]), type(document).model_fields
    values = [
        found
        for name in SECTIONS
        for found in walk.values(
            getattr(document, name), (name,), kinds[name], fields[name].description or ""
        )
    ]
    return SettableShot(clock, values, times, walk.curves)


@dataclass(frozen=True)
class _Walk:
    """Lists the values of documents.

    first, last  frames between which curves are sampled: those that the shot or one of its flows reaches
    curves       those that were met
    """

    source: YamlSource
    clock: Clock
    first: int
    last: int
    curves: dict[Where, Any] = dataclasses.field(default_factory=dict)

    def values(self, value: Any, where: Where, kind: Any, description: str) -> Iterator[SettableValue]:
        """Yield the values within a part of a document.

        kind         its annotation
        description  what it is, with its unit in parentheses
        """
        if isinstance(value, BaseModel) and not _is_curve(value):
            yield from self._document(value, where)
        elif isinstance(value, list) and any(isinstance(item, BaseModel) for item in value):
            for index, item in enumerate(value):
                yield from self.values(item, (*where, index), None, "")
        elif isinstance(value, dict):
            for name, item in value.items():
                yield from self.values(item, (*where, name), None, description)
        elif (found := self._value(value, where, kind, description)) is not None:
            yield found

    def _document(self, document: BaseModel, where: Where) -> Iterator[SettableValue]:
        fields = field_names([type(document)])
        units = {p.name: p.doc for p in getattr(document, "own", ())}
        for name, field in type(document).model_fields.items():
            word = field.alias or name
            value = getattr(document, name)
            description = field.description or ""
            if word in units:
                doc = units[word]
                description = f"{doc.text} ({doc.unit})" if doc.unit else doc.text
            is_given = name in document.model_fields_set and self.source.get(*where, word) is not None
            is_leaf = not isinstance(value, BaseModel | dict) and value is not None
            if is_given or (is_leaf and isinstance(self.source.get(*where), dict | None)):
                yield from self.values(value, (*where, word), fields[word], description)

    def _value(self, value: Any, where: Where, kind: Any, description: str) -> SettableValue | None:
        raw = self.source.get(*where)
        form = _form(value, kind)
        if form is None:
            return None
        words, _, unit = description.rpartition(" (")
        has_unit = description.endswith(")") and bool(words)
        low, high = _bounds(kind)
        spot = self.source.spot_of(where)
        file = "" if raw is None or spot.file == str(self.source.path) else spot.file
        curve = self._curve(value, where) if form == "curve" else None
        return SettableValue(
            where,
            form,
            raw if raw is not None else value,
            unit[:-1] if has_unit else "",
            words if has_unit else description,
            low,
            high,
            self._names(kind),
            raw is not None,
            file,
            any(map(_has_keys, members(kind))),
            form == "vector" or (curve is not None and len(curve.values[0]) == 3),
            curve,
        )

    def _names(self, kind: Any) -> tuple[str, ...]:
        """Return the names that a value can have, with those that the show gives to looks and light rigs."""
        names = choices(kind)
        for registry, own in ((PRESETS["look"], "looks"), (PRESETS["lights"], "rigs")):
            if names == tuple(registry):
                return *names, *(name for name in map(str, self.source.mapping(own)) if name not in names)
        return names

    def _curve(self, value: Any, where: Where) -> SampledCurve:
        """Return the samples of a curve, by its own clock."""
        first, last = self.first, self.last
        frames = np.linspace(first, last, min(MOST_SAMPLES, max(LEAST_SAMPLES, 2 * (last - first) + 1)))
        curve = self.curves[where] = value.curve(self.clock)
        values = [list(curve.at(self.clock.time(float(frame)))) for frame in frames]
        keys = []
        if "keys" in type(value).model_fields:
            for time, key in value.keys.items():
                own = key if isinstance(key, BaseModel) else None
                value_there: Any = key if own is None else key.value
                seconds = self.clock.seconds(time) or 0.0
                keys.append(
                    {
                        "time": time,
                        "frame": round(self.clock.frames.first + seconds * float(self.clock.rate.fps), 6),
                        "value": value_there if isinstance(value_there, list) else [value_there],
                        "ease": None if own is None else key.ease,
                        "is_detailed": own is not None,
                        "left": self._handle(None if own is None else key.left),
                        "right": self._handle(None if own is None else key.right),
                    }
                )
            return SampledCurve(frames.tolist(), values, keys, value.ease, value.before, value.after, None)
        return SampledCurve(frames.tolist(), values, keys, "", "hold", "hold", value.formula)

    def _handle(self, handle: list[Any] | None) -> list[Any] | None:
        """Return a handle as frames and values, relative to its key."""
        if handle is None:
            return None
        seconds = self.clock.length(handle[0]) or 0.0
        offset = handle[1] if isinstance(handle[1], list) else [handle[1]]
        return [round(seconds * float(self.clock.rate.fps), 6), offset]


def _form(value: Any, kind: Any) -> str | None:
    """Return the form of a value; None for one that is not listed."""
    if _is_curve(value):
        return "curve"
    if isinstance(value, bool):
        return "switch"
    names = choices(kind)
    if isinstance(value, str):
        return "axis" if names == ("x", "y", "z") else "name" if names else None
    if is_number(value):
        is_whole = isinstance(value, int) and int in members(kind)
        return "whole" if is_whole else "number"
    if isinstance(value, list) and len(value) == 3 and all(map(is_number, value)):
        return "axis" if names == ("x", "y", "z") else "vector"
    return None


def _is_curve(value: Any) -> bool:
    """Tell whether a value is keys or a formula; what follows a sound has no curve to edit."""
    return isinstance(value, Changing) and "audio" not in type(value).model_fields


def _has_keys(kind: Any) -> bool:
    """Tell whether a type is that of keys."""
    return isinstance(kind, type) and issubclass(kind, BaseModel) and "keys" in kind.model_fields


def _seconds(duration: Any, clock: Clock) -> float:
    """Return a parsed duration in seconds."""
    return clock.length(duration) or 0.0


def _bounds(kind: Any) -> tuple[float, float]:
    """Return the lowest and highest number of a setting; infinite where any number is allowed."""
    low, high = [-math.inf], [math.inf]
    waiting: list[Any] = [kind]
    while waiting:
        part = waiting.pop()
        if typing.get_origin(part) is Annotated:
            rules = [each for rule in part.__metadata__ for each in (rule, *getattr(rule, "metadata", ()))]
            low += _limits(rules, ("ge", "gt"))
            high += _limits(rules, ("le", "lt"))
            waiting.append(part.__origin__)
        elif not isinstance(part, type):
            waiting += typing.get_args(part)
    return float(max(low)), float(min(high))


def _limits(rules: list[Any], names: tuple[str, str]) -> list[float]:
    """Return the numbers that rules such as `Field(ge=0)` have under some names."""
    limits = [getattr(rule, name, None) for rule in rules for name in names]
    numbers = [float(limit) for limit in limits if limit is not None and is_number(limit)]
    return [number for number in numbers if abs(number) < 1e12]
