"""Weights of flows."""

from __future__ import annotations

from pipeline.errors import FrameError
from pipeline.flow.choreography import Number, number_at


def weight_at(weight: Number, time: float, name: str) -> float:
    """A weight at a time. Raises FrameError, of the flow `name`, where it is not from 0 to 1."""
    value = float(number_at(weight, time))
    if not -1e-12 <= value <= 1.0 + 1e-12:
        raise FrameError(
            f"flow {name} has the weight {value:g} at {time:g} s; a weight is from 0 to 1. "
            "Mend its keys, or choose an easing that does not overshoot."
        )
    return min(max(value, 0.0), 1.0)
