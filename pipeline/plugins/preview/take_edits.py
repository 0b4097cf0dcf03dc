"""Edits that put performed keys into a shot file, and leave its curves outside of the take as they were."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.preview.curve_fitting import FittedCurve, FittedKey, fit
from flowsculpt.pipeline.plugins.preview.performed_takes import PerformedValue, file_keys
from flowsculpt.pipeline.plugins.preview.settable_values import SettableShot, SettableValue
from flowsculpt.pipeline.plugins.preview.text_edits import KeySpan, ValueEdit, Where, path_text, with_times

EXACT = 1e-4  # distance of what is fitted to a curve of the file, over the range of that curve

PER_FRAME = 4  # samples of a curve of the file that is fitted

SLOPE_STEP = 1e-4  # frames over which the slope of a curve is measured

Key = tuple[float, dict[str, Any]]
"""The frame of a key, and its data as the file has them."""


def take_edits(shot: SettableShot, taken: PerformedValue) -> list[ValueEdit]:
    """Return the edits that give a value the keys of a take.

    A constant has these keys alone. Keys of the file before and after the take stay: the curve goes on to the
    next of them. A segment that the take cuts is fitted up to the cut; a formula, and keys that repeat, are
    fitted over the frames of the shot.

    Raises UsageError where the shot has no such value, or one of another kind.
    """
    where = tuple(taken.where)
    value = shot.by_path.get(where)
    if value is None:
        raise UsageError(f"{path_text(where)} is not in this shot; the take keeps its samples")
    if not (value.can_change or value.curve):
        raise UsageError(f"{path_text(where)} takes no keys; the take keeps its samples")
    if value.is_vector != (len(taken.samples[0]) == 3):
        kinds = ("a vector", "a number") if value.is_vector else ("a number", "a vector")
        raise UsageError(f"{path_text(where)} is {kinds[0]} now, and {kinds[1]} in the take; choose another")
    performed = [(key.time, key.data) for key in taken.keys]
    if value.curve is None:
        return [ValueEdit("set", where, {"keys": _named(performed)})]
    return _Merge(shot, value, where).edits(performed)


def restoring_edits(shot: SettableShot, taken: PerformedValue) -> list[ValueEdit]:
    """Return the edits that give a value back what it had before a take."""
    where = tuple(taken.where)
    value = shot.by_path.get(where)
    if taken.before is None:
        return [] if value is None else [ValueEdit("remove", where)]
    before = with_times(taken.before)
    if isinstance(before, dict) and "keys" in before and value and value.curve and value.curve.keys:
        return [ValueEdit("keys", (*where, "keys"), _all_keys(before["keys"]))]
    return [ValueEdit("set", where, before)]


def _all_keys(keys: dict[Any, Any]) -> KeySpan:
    """Return keys in place of all that there are."""
    return KeySpan(-math.inf, math.inf, keys)


def is_chosen(value: SettableValue, taken: PerformedValue) -> bool:
    """Tell whether a value of a shot has the keys of a take."""
    if value.curve is None or not isinstance(value.value, dict):
        return False
    held = value.value.get("keys") or {}
    there = {round(float(time), 3): key for time, key in held.items() if isinstance(time, int | float)}
    found = [(there.get(key.time), key.value) for key in taken.keys]
    return all(isinstance(own, dict) and own.get("value") == value for own, value in found)


def _named(keys: list[Key]) -> dict[Any, Any]:
    return {(int(time) if float(time).is_integer() else time): data for time, data in keys}


class _Merge:
    """Puts keys of a take among those that a value has."""

    def __init__(self, shot: SettableShot, value: SettableValue, where: Where) -> None:
        assert value.curve is not None, "constants have no keys to merge with"
        self.shot, self.value, self.where, self.curve = shot, value, where, value.curve
        self.at = shot.curves[where]
        self.clock = shot.clock
        sampled = np.array(self.curve.values)
        ranges = np.ptp(sampled, axis=0)
        self.ranges = np.where(ranges > 0, ranges, np.maximum(np.abs(sampled).max(axis=0), 1e-6))

    def edits(self, performed: list[Key]) -> list[ValueEdit]:
        first, last = performed[0][0], performed[-1][0]
        frames = [key["frame"] for key in self.curve.keys]
        if not frames or self._repeats(first, last, frames):
            ends = self.shot.own_frames(self.where)
            low, high = min(*ends, first), max(*ends, last)
            before = self._fitted(low, first) if low < first else []
            if before:
                self._join(before, performed)
            after = self._after(last, high)
            every = _named([*before, *performed, *after])
            if frames:
                return [ValueEdit("keys", (*self.where, "keys"), _all_keys(every))]
            return [ValueEdit("set", self.where, {"keys": every})]
        left = [i for i, frame in enumerate(frames) if frame < first - 1e-6]
        right = [i for i, frame in enumerate(frames) if frame > last + 1e-6]
        before = self._cut_before(left[-1], first, performed) if left else []
        after = self._cut_after(right[0], last) if right else []
        keys = [*before, *performed, *after]
        span = [self._seconds(keys[0][0]), self._seconds(keys[-1][0])]
        named = _named(keys)
        for i in (*left[-1:], *right[:1]):  # the file may have them in seconds
            frame = frames[i]
            named = {(self.curve.keys[i]["time"] if t == frame else t): key for t, key in named.items()}
        if self.value.file:
            name = path_text(self.where)
            raise UsageError(f"{name} has its keys from {self.value.file}; write them into this shot first")
        return [ValueEdit("keys", (*self.where, "keys"), KeySpan(span[0], span[1], named))]

    def _repeats(self, first: float, last: float, frames: list[float]) -> bool:
        """Tell whether the curve outside of its keys, and of the take, is more than a constant."""
        return (self.curve.before != "hold" and first < frames[0]) or (
            self.curve.after != "hold" and last > frames[-1]
        )

    def _cut_before(self, index: int, first: float, performed: list[Key]) -> list[Key]:
        """Return the last key before the take, and those up to it; the take's first key ends the segment."""
        key = self.curve.keys[index]
        fitted = self._fitted(key["frame"], first)
        self._join(fitted, performed)
        left = self._handle(index, -1)
        return [(key["frame"], {**fitted[0][1], **({"left": left} if left else {})}), *fitted[1:]]

    @staticmethod
    def _join(before: list[Key], performed: list[Key]) -> None:
        """Give the first performed key the handle of the last one before, which lies there too and goes."""
        _, end = before.pop()
        performed[0] = performed[0][0], {**performed[0][1], "left": end["left"]}

    def _cut_after(self, index: int, last: float) -> list[Key]:
        """Return the keys from the take to the next key of the file, and this one."""
        key = self.curve.keys[index]
        fitted = self._after(last, key["frame"])
        right = self._handle(index, 1)
        if not fitted:
            fitted = [(key["frame"], {"value": self._in_file(key["value"])})]
        own = {"ease": key["ease"]} if key["ease"] and not right else {}
        fitted[-1] = key["frame"], {**fitted[-1][1], **own, **({"right": right} if right else {})}
        return fitted

    def _after(self, last: float, end: float) -> list[Key]:
        """Return the keys of the file's curve from a frame after the take on."""
        begin = math.floor(last) + 1.0 if last == math.floor(last) else math.ceil(last)
        return self._fitted(begin, end) if begin < end - 1e-6 else []

    def _handle(self, index: int, side: int) -> list[Any] | None:
        """Return the handle of a key on the side that stays: an automatic one as it is now."""
        keys, key = self.curve.keys, self.curve.keys[index]
        if not 0 <= index + side < len(keys):
            return None
        start = keys[min(index, index + side)]
        ease = start["ease"] or ("bezier" if start["right"] else self.curve.ease)
        if ease != "bezier":
            return None
        given = key["left" if side < 0 else "right"]
        if given is not None:
            return [given[0], self._in_file(given[1])]
        third = (keys[index + side]["frame"] - key["frame"]) / 3.0
        near = self._values(np.array([key["frame"] + side * SLOPE_STEP]))[0]
        rise = (near - np.array(key["value"])) / SLOPE_STEP * abs(third)
        return [round(third, 4), self._in_file([round(x, 6) for x in rise.tolist()])]

    def _fitted(self, start: float, end: float) -> list[Key]:
        """Return keys of the file's curve over some frames."""
        count = max(8, math.ceil(PER_FRAME * (end - start)) + 1)
        frames = np.linspace(start, end, count)
        values = self._values(frames)
        curve = fit(frames, values, EXACT * self.ranges)
        exact = [FittedKey(key.time, key.value, key.slope) for key in curve.keys]
        exact[0] = exact[0]._replace(value=values[0])
        exact[-1] = exact[-1]._replace(value=values[-1])
        keys = file_keys(FittedCurve(exact, curve.error), self.ranges * 0.01)
        return [(key.time, key.data) for key in keys]

    def _values(self, frames: Floats) -> Floats:
        return np.array([self.at.at(self.clock.time(float(frame))) for frame in frames])

    def _seconds(self, frame: float) -> float:
        return float(self.clock.seconds(frame) or 0.0)

    def _in_file(self, row: list[float]) -> Any:
        return row if self.value.is_vector else row[0]
