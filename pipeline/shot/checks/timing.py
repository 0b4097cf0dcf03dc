"""What keys must obey beyond the form of their values: checks like those of `checks`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pipeline.flow.keyframes import BEZIER
from pipeline.frames import FrameRange, FrameRate, shortened
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NumberField, number
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.source import Source, Where


def keys(source: Source, clock: Clock | None) -> Iterator[Problem]:
    """Keys are frames or seconds, ascending, and within the shot; handles point where they should."""
    for where, mapping in source.mappings():
        inner = mapping.get("keys")
        if isinstance(inner, dict):
            yield from _times(inner, (*where, "keys"), clock, of_flow=where[:1] == ("flows",))
            yield from _handles(mapping, (*where, "keys"), clock or _ANY)


_ANY = Clock(FrameRange.of([1]), FrameRate.of(24))
"""The clock of a shot whose own cannot be read."""


def _times(keys: dict[Any, Any], where: Where, clock: Clock | None, of_flow: bool) -> Iterator[Problem]:
    before: tuple[Any, float] | None = None
    for key in keys:
        seconds = (clock or _ANY).seconds(key)
        if seconds is None:
            yield (
                (*where, key),
                f"key {shortened(key)} is no time; write a frame, such as 12, or seconds, such as 0.5s",
            )
            continue
        if clock and not clock.holds(seconds) and not (of_flow and clock.flow_holds(seconds)):
            yield (
                (*where, key),
                (
                    f"key {_shown(key)} is outside of the shot, which has frames {clock.frames} "
                    f"({clock.duration:.4g} s). Move it inside."
                ),
            )
        elif before and math.isclose(seconds, before[1], rel_tol=0, abs_tol=1e-9):
            yield (
                (*where, key),
                f"key {_shown(key)} is the same moment as key {_shown(before[0])}; a moment has one value. "
                "Remove one of them.",
            )
        elif before and seconds < before[1]:
            yield (
                (*where, key),
                f"key {_shown(key)} comes after key {_shown(before[0])}; keys go forward in time. Sort them.",
            )
        before = key, seconds


def _shown(key: float | str) -> str:
    """A key in a message: a number as it stands, unless it fills the line."""
    return shortened(key).strip("'")


def _handles(mapping: dict[Any, Any], where: Where, clock: Clock) -> Iterator[Problem]:
    """A handle is [time, value] away from its key, on its own side, of a way that is Bézier's."""
    items = list(mapping["keys"].items())
    for i, (key, item) in enumerate(items):
        if not isinstance(item, dict):
            continue
        for side, way in (("left", items[i - 1][1] if i else None), ("right", item)):
            handle, place = item.get(side), (*where, key, side)
            if handle is None:
                continue
            fault = _fault(side, handle, item.get("value"), clock)
            if fault:
                yield place, fault
            elif way is not None and not _is_bezier(way, mapping.get("ease")):
                yield (
                    place,
                    f"{side} is a handle of a way that is not Bézier's. Write ease: bezier with "
                    f"{'the key before' if side == 'left' else 'the key'}, or leave {side} out.",
                )


def _is_bezier(item: Any, ease: Any) -> bool:
    own = item.get("ease", BEZIER if "right" in item else ease) if isinstance(item, dict) else ease
    return bool(own == BEZIER)


def _fault(side: str, handle: Any, value: Any, clock: Clock) -> str | None:
    how = f"a handle is [time, value] away from its key, such as [{'-6' if side == 'left' else '6'}, 0.5]"
    if not isinstance(handle, list) or len(handle) != 2:
        return f"{side} is {shortened(handle)}; {how}"
    seconds, away = clock.length(handle[0]), handle[1]
    if seconds is None or not math.isfinite(seconds):
        return f"{side} has {shortened(handle[0])} for its time, which is frames, or seconds as 0.5s; {how}"
    if seconds < 0 if side == "right" else seconds > 0:
        sign = "negative" if side == "left" else "positive"
        return f"{side} has {shortened(handle[0])} for its time, which must be {sign} there. Turn it round."
    wanted = len(value) if isinstance(value, list) else 1
    parts = away if isinstance(away, list) else [away]
    if not all(is_number(part) and abs(part) <= 1e12 for part in parts):
        return f"{side} has {shortened(away)} for its value; {how}"
    if len(parts) != wanted or isinstance(away, list) != isinstance(value, list):
        return f"{side} has {len(parts)} numbers and its key {wanted}; they have as many. Write all of them."
    return None


SPEED: TypeAdapter[Any] = TypeAdapter(NumberField, config=ConfigDict(strict=True, allow_inf_nan=False))


def with_speed(clock: Clock, written: Any) -> tuple[Clock, list[tuple[Where, str]]]:
    """The clock with the speed as it is written, and what is wrong with it between half frames.

    Without it where it is no good; what is not looked at here is told elsewhere.
    """
    try:
        speed = SPEED.validate_python(written, context={"clock": clock})
        retimed = dataclasses.replace(clock, speed=number(speed, clock))
    except (ValidationError, AssertionError):
        return clock, []
    fault = retimed.speed_fault()
    return (clock, [(("speed",), fault)]) if fault else (retimed, [])
