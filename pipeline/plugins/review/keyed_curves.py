"""Curves of a shot: everything in its file that changes over time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from flowsculpt.api.flows import Keyframes
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import Changing, Clock, WrittenShot, read_shot

SAMPLES = 16
"""Samples of a curve in a frame."""


@dataclass(frozen=True)
class KeyedCurve:
    """One parameter over the frames of its shot.

    name    its path in the file: `flows.0.sum.1.vortex.strength`
    unit    of its values in the file
    frames  (T,) from the first to the last, with fractions
    values  (T, K), three of them for a place
    keys    (N, 1 + K): the frames at which keys are reached, and the values there
    """

    name: str
    unit: str
    frames: Floats
    values: Floats
    keys: Floats


def curves_of(path: str | Path, settings: Iterable[str] = ()) -> list[KeyedCurve]:
    """Return the curves of a shot in the order of its file. Raises what `read_shot` raises."""
    path, settings = Path(path), tuple(settings)
    shot = read_shot(path, settings=settings)
    clock = shot.motion.clock
    written = WrittenShot.read(path, settings=settings)
    document, order = written.document(clock), list(written.source.data)
    curves = sorted(_changing(document, (), ""), key=lambda curve: order.index(curve[0][0]))
    return [_curve(names, unit, value, clock) for names, unit, value in curves]


def _changing(value: Any, names: tuple[str, ...], unit: str) -> Iterator[tuple[tuple[str, ...], str, Any]]:
    """Yield path, unit and value of what changes over time within a part of a document."""
    if isinstance(value, Changing):
        yield names, unit, value
    elif isinstance(value, BaseModel):
        units = {p.name: p.doc.unit for p in getattr(value, "own", ())}
        for name, field in type(value).model_fields.items():
            if name in value.model_fields_set:
                word = field.alias or name
                inner = units.get(word) or _unit_of(field.description)
                yield from _changing(getattr(value, name), (*names, word), inner)
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _changing(item, (*names, str(name)), unit)
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _changing(item, (*names, str(i)), unit)


def _unit_of(description: str | None) -> str:
    """Return the unit that stands in parentheses at the end of a description."""
    match = re.search(r"\(([^()]*)\)$", description or "")
    return match[1] if match else ""


def _curve(names: tuple[str, ...], unit: str, value: Any, clock: Clock) -> KeyedCurve:
    curve = value.curve(clock)
    first, last = clock.frames.first, clock.frames.last
    frames = np.linspace(first, last, SAMPLES * (last - first) + 1)
    is_of_flow = names[0] == "flows" or (names[0], names[2:3]) == ("subjects", ("flows",))
    time_of = clock.flow_time if is_of_flow else clock.time
    times = np.array([time_of(float(frame)) for frame in frames])
    values = np.array([curve.at(float(time)) for time in times])
    return KeyedCurve(
        ".".join(names),
        unit,
        frames,
        values,
        _keys(curve if isinstance(curve, Keyframes) else None, frames, times),
    )


def _keys(curve: Keyframes | None, frames: Floats, times: Floats) -> Floats:
    """Return the frames at which keys are reached: one, several where the flow's time turns back, or none."""
    if curve is None:
        return np.empty((0, 2))
    rows = []
    for time, value in zip(curve.times, curve.values, strict=True):
        for i in np.flatnonzero((times[:-1] - time) * (times[1:] - time) <= 0.0):
            step = times[i + 1] - times[i]
            fraction = (time - times[i]) / step if step else 0.0
            rows.append((round(float(frames[i] + fraction / SAMPLES), 6), *value))
    return np.array(sorted(set(rows))) if rows else np.empty((0, 2))
