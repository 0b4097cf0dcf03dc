"""The distribution of the values of all frames of a shot."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.meshes import Floats

MOST = 4096
"""Values of a frame that are kept, evenly among its vertices, besides the least and the greatest."""

STEPS = 1000
"""Equal fractions between which quantiles are interpolated."""

VERSION = 1
"""Raised when equal values give other quantiles."""


class ValueSamples:
    """Values of frames, whose quantiles follow once all have come. A vertex counts in each of its frames."""

    def __init__(self, frames: int, data: Callable[[], Any]) -> None:
        """Begin with no frame. data: returns all that decides the values of all frames, JSON-able"""
        self._frames, self._data = frames, data
        self._values: dict[int, tuple[Floats, Floats]] = {}

    def note(self, frame: int, values: Floats) -> None:
        """Note the values (V,) of a frame; NaN are left out."""
        if self.table is not None:
            return
        known = np.sort(values[np.isfinite(values)])
        some = known[np.unique(np.linspace(0, max(0, len(known) - 1), min(MOST, len(known))).astype(int))]
        self._values[frame] = some, np.full(len(some), len(known) / max(1, len(some)))
        if len(self._values) == self._frames:
            values, weights = (np.concatenate(each) for each in zip(*self._values.values(), strict=True))
            if len(values):
                table = self.__dict__["table"] = _quantiles(values, weights).tolist()
                self._answer.store_alone({"quantiles": table})

    def quantiles(self, shares: Sequence[float]) -> Sequence[float] | None:
        """Return the numbers below which fractions of the values lie; None before all frames have come."""
        if self.table is None:
            return None
        return np.interp(shares, np.linspace(0.0, 1.0, STEPS + 1), self.table).tolist()

    @cached_property
    def table(self) -> list[float] | None:
        """Quantiles of STEPS equal fractions; None before all frames have come."""
        return self._answer.load(_table)

    @cached_property
    def _answer(self) -> CachedAnswer:
        return CachedAnswer.of("values", [str(VERSION), json.dumps(self._data())])


def _table(answer: dict[str, Any]) -> list[float]:
    table = [float(each) for each in answer["quantiles"]]
    if len(table) != STEPS + 1:
        raise ValueError("of another length")
    return table


def _quantiles(values: Floats, weights: Floats) -> Floats:
    """Return quantiles (STEPS + 1,) of values with weights; the first and last are the least and greatest."""
    order = np.argsort(values)
    values, weights = values[order], weights[order]
    ends = np.cumsum(weights)
    places = (ends - 0.5 * weights) / ends[-1]
    places[0], places[-1] = 0.0, 1.0
    return np.interp(np.linspace(0.0, 1.0, STEPS + 1), places, values)
