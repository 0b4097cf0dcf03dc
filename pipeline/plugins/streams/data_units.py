"""Units and dates of the data that velocities come from."""

from __future__ import annotations

from typing import Any

import numpy as np

from flowsculpt import VelocityField
from flowsculpt.api.flows import Sampled, number_at

_PERIODS = {86400.0: "days", 3600.0: "hours", 1.0: "s"}
"""Units of time in seconds, the longest first."""


def sampled_in(velocity: VelocityField) -> Sampled | None:
    """Return the data that a velocity field comes from; None without any, or with several."""
    found = [field for field, _ in velocity.leaves(np.zeros(3), 0.0) if isinstance(field, Sampled)]
    return found[0] if len(found) == 1 else None


def metres_in(velocity: VelocityField) -> float | None:
    """Return the length of a unit of the scene in metres; None where the data do not say it."""
    sampled = sampled_in(velocity)
    if sampled is None or sampled.samples.metre is None:
        return None
    return 1.0 / (sampled.samples.metre * number_at(sampled.scale, 0.0))


def facts_of_data(velocity: VelocityField, time: float) -> dict[str, Any]:
    """Return the date of the data at a time of the flow, and the length of a unit in metres, where known."""
    sampled, metres = sampled_in(velocity), metres_in(velocity)
    if sampled is None:
        return {}
    date = sampled.samples.date(sampled.seconds(time))
    return {**({"date": date} if date else {}), **({"metres": metres} if metres else {})}


def in_units_of_data(of: str, unit: str, velocity: VelocityField) -> tuple[str, float]:
    """Return the unit of a measure of the flow, and the factor on numbers in units and seconds of the shot.

    Data that know how long a metre is and how fast they pass give them their own units. On a plane, lengths
    are true along its middle latitude. Speeds and vorticities of data without units are their own: a constant
    `scale` and `strength` are undone.
    """
    sampled, metres = sampled_in(velocity), metres_in(velocity)
    if sampled is not None and sampled.samples.metre is None and not sampled.samples.is_paced:
        scale, strength = sampled.scale, sampled.strength
        if not (isinstance(scale, int | float) and isinstance(strength, int | float) and strength > 0.0):
            return unit, 1.0
        return unit, {"speed": 1.0 / (scale * strength), "vorticity": 1.0 / strength}.get(of, 1.0)
    if sampled is None or metres is None or not sampled.samples.is_paced or not sampled.time_scale > 0.0:
        return unit, 1.0
    pace = sampled.time_scale
    seconds, name = next(item for item in _PERIODS.items() if pace >= item[0] or item[0] == 1.0)
    return {
        "speed": ("m/s", metres / pace),
        "vorticity": ("1/s", 1.0 / pace),
        "age": (name, pace / seconds),
        "ftle": (f"1/{name.rstrip('s') or name}", seconds / pace),
    }.get(of, (unit, 1.0))
