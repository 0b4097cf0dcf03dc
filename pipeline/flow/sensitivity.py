"""The parameters of a velocity field that a cost follows from, found by changing each by a factor of two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass, replace
from typing import NamedTuple

from pipeline.flow.parameters import number_at, parameters_of
from pipeline.flow.velocity import VelocityField

CLEARLY = 0.6
"""A parameter matters where a factor of two lowers the cost to this share."""

Settings = tuple[tuple[str, float], ...]
"""Parameters with their values, as in shot files."""


class Sensitivity(NamedTuple):
    """Parameters that lower a cost when they are raised, and those that do when they are lowered."""

    raised: Settings = ()
    lowered: Settings = ()

    def __str__(self) -> str:
        """`size 1, strength 40`; empty where no parameter matters"""
        return ", ".join(f"{name} {value:g}" for name, value in (*self.raised, *self.lowered))

    def __bool__(self) -> bool:
        return bool(self.raised or self.lowered)

    @property
    def remedies(self) -> list[str]:
        """`raise size`, `lower strength`"""
        verbs = ("raise", self.raised), ("lower", self.lowered)
        return [f"{verb} {' or '.join(name for name, _ in named)}" for verb, named in verbs if named]


def sensitivity(field: VelocityField, cost_of: Callable[[VelocityField], float], time: float) -> Sensitivity:
    """Return the parameters of a field, at a time, that lower its cost most clearly."""
    raised: list[tuple[str, float]] = []
    lowered: list[tuple[str, float]] = []
    now = cost_of(field)
    for parameter in parameters_of(type(field)):
        if parameter.form not in ("number", "constant"):
            continue
        value = number_at(getattr(field, parameter.name), time)
        for factor, found in ((2.0, raised), (0.5, lowered)):
            if value and cost_of(_with(field, parameter.name, factor * value)) < CLEARLY * now:
                found.append((parameter.name, value / parameter.doc.factor))
    return Sensitivity(tuple(raised), tuple(lowered))


def _with(field: VelocityField, name: str, value: float) -> VelocityField:
    """Return the field with another value of a parameter."""
    assert is_dataclass(field) and not isinstance(field, type)
    return replace(field, **{name: value})
