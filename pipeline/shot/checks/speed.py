"""The speed that a shot file writes, before the rest of the file is looked at: keys of flows go by it."""

from __future__ import annotations

import dataclasses
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NumberField, number
from pipeline.shot.yaml.source import Where

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
