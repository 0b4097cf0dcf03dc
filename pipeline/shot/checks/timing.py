"""Checks of frames, rate, speed and the times of keys."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pipeline.errors import UsageError
from pipeline.flow.easing import BEZIER
from pipeline.frames import FrameRange, FrameRate, shortened
from pipeline.shot.clock import Clock, parse_frames, parse_rate
from pipeline.shot.documents.curves import NumberField, number
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.source import Problem, Where, YamlSource

_SPEED: TypeAdapter[Any] = TypeAdapter(NumberField, config=ConfigDict(strict=True, allow_inf_nan=False))

_ANY = Clock(FrameRange.of([1]), FrameRate.of(24))
"""Stands in for the clock of a shot whose own has problems."""


def read_clock(source: YamlSource) -> tuple[Clock | None, list[Problem]]:
    """Return the shot's clock, without its speed, or the problems with it."""
    rate, problems = read_rate(source)
    text = source.get("frames")
    if not isinstance(text, str):
        return None, problems  # the document reports it
    try:
        frames = parse_frames(text)
    except UsageError as error:
        return None, [*problems, (("frames",), str(error))]
    return (Clock(frames, rate) if rate else None), problems


def read_rate(source: YamlSource) -> tuple[FrameRate | None, list[Problem]]:
    """Return the frame rate, 24 by default, or the problem with it."""
    try:
        return parse_rate(source.get("rate")), []
    except UsageError as error:
        return None, [(("rate",), str(error))]


def with_speed(clock: Clock, speed: Any) -> tuple[Clock, list[Problem]]:
    """Return the clock with the speed of the file, and the problem with it between half frames.

    The keys of flows go by the speed, so it is read before the rest of the file. The document reports a speed
    that is no valid number; the clock is returned without it.
    """
    try:
        parsed = _SPEED.validate_python(speed, context={"clock": clock})
        retimed = dataclasses.replace(clock, speed=number(parsed, clock))
    except (ValidationError, AssertionError):
        return clock, []
    fault = retimed.speed_fault()
    return (clock, [(("speed",), fault)]) if fault else (retimed, [])


def keys(source: YamlSource, clock: Clock | None) -> Iterator[Problem]:
    """Check that keys are frames or seconds, ascend, and lie within the shot, and the form of handles."""
    for where, mapping in source.mappings():
        inner = mapping.get("keys")
        if isinstance(inner, dict):
            yield from _times(inner, (*where, "keys"), clock, in_flows=where[:1] == ("flows",))
            yield from _handles(mapping, (*where, "keys"), clock or _ANY)


def _times(keys: dict[Any, Any], where: Where, clock: Clock | None, in_flows: bool) -> Iterator[Problem]:
    before: tuple[Any, float] | None = None
    for key in keys:
        place, seconds = (*where, key), (clock or _ANY).seconds(key)
        if seconds is None:
            yield (
                place,
                f"key {shortened(key)} is no time; write a frame, such as 12, or seconds, such as 0.5s",
            )
            continue
        if clock and not clock.holds(seconds) and not (in_flows and clock.flow_holds(seconds)):
            yield (
                place,
                f"key {_shown(key)} is outside of the shot, which has frames {clock.frames} "
                f"({clock.duration:.4g} s). Move it inside.",
            )
        elif before and math.isclose(seconds, before[1], rel_tol=0, abs_tol=1e-9):
            yield (
                place,
                f"key {_shown(key)} is at the same time as key {_shown(before[0])}; a time has one value. "
                "Remove one of them.",
            )
        elif before and seconds < before[1]:
            yield (
                place,
                f"key {_shown(key)} comes after key {_shown(before[0])}; keys go forward in time. Sort them.",
            )
        before = key, seconds


def _shown(key: float | str) -> str:
    """Return a key for a message: as it stands, unless it is too long."""
    return shortened(key).strip("'")


def _handles(mapping: dict[Any, Any], where: Where, clock: Clock) -> Iterator[Problem]:
    """Check that a handle is [time, value], on its side of the key, beside a Bézier segment."""
    items = list(mapping["keys"].items())
    for i, (key, item) in enumerate(items):
        if not isinstance(item, dict):
            continue
        for side, segment in (("left", items[i - 1][1] if i else None), ("right", item)):
            handle, place = item.get(side), (*where, key, side)
            if handle is None:
                continue
            fault = _handle_fault(side, handle, item.get("value"), clock)
            if fault:
                yield place, fault
            elif segment is not None and not _is_bezier(segment, mapping.get("ease")):
                yield (
                    place,
                    f"{side} is a handle beside a segment that is not Bézier. Write ease: bezier with "
                    f"{'the key before' if side == 'left' else 'the key'}, or leave {side} out.",
                )


def _is_bezier(item: Any, ease: Any) -> bool:
    own = item.get("ease", BEZIER if "right" in item else ease) if isinstance(item, dict) else ease
    return bool(own == BEZIER)


def _handle_fault(side: str, handle: Any, value: Any, clock: Clock) -> str | None:
    rule = f"a handle is [time, value] away from its key, such as [{'-6' if side == 'left' else '6'}, 0.5]"
    if not isinstance(handle, list) or len(handle) != 2:
        return f"{side} is {shortened(handle)}; {rule}"
    seconds, away = clock.length(handle[0]), handle[1]
    if seconds is None or not math.isfinite(seconds):
        return f"{side} has {shortened(handle[0])} for its time, which is frames, or seconds as 0.5s; {rule}"
    if seconds < 0 if side == "right" else seconds > 0:
        sign = "negative" if side == "left" else "positive"
        return f"{side} has {shortened(handle[0])} for its time, which must be {sign} there. Turn it round."
    wanted = len(value) if isinstance(value, list) else 1
    parts = away if isinstance(away, list) else [away]
    if not all(is_number(part) and abs(part) <= 1e12 for part in parts):
        return f"{side} has {shortened(away)} for its value; {rule}"
    if len(parts) != wanted or isinstance(away, list) != isinstance(value, list):
        return f"{side} has {len(parts)} numbers and its key {wanted}; they need as many. Write all of them."
    return None
