"""What a shot file says under `shutter` and `aovs`: how long light comes in, and which layers it leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Tag, ValidationInfo
from pydantic_core import PydanticCustomError

from pipeline.errors import UsageError
from pipeline.flow.keyframes import Number, number_at
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import MOST_LOOKS, NumberField, number
from pipeline.shot.documents.fields import DEGREE, Document, one_of
from render.scene.aovs import AOVS, EXTRA

TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Shutter:
    """A rotating shutter: light comes in for a part of each turn, and a turn is a frame.

    angle  radians for which it is open, 0 to 2π, constant or keyed; 0: pictures show one moment
    phase  radians from the moment of the frame at which it opens, -2π to 0; None: half the angle before it
    """

    angle: Number = 0.0
    phase: Number | None = None

    def open_at(self, time: float) -> tuple[float, float] | None:
        """When it opens and closes, in frames from the moment of a frame at `time` seconds; None if never."""
        angle = number_at(self.angle, time)
        if not angle > 0.0:
            return None
        opens = -0.5 * angle if self.phase is None else number_at(self.phase, time)
        return max(opens / TURN, -1.0), min((opens + angle) / TURN, 1.0)


def _between(low: float, high: float) -> AfterValidator:
    """A validator: degrees that stay within bounds at every half frame of the shot."""

    def check(value: Any, info: ValidationInfo) -> Any:
        clock: Clock | None = (info.context or {}).get("clock")
        if clock is None:
            return value
        first, last = clock.frames.first, clock.frames.last
        halves = range(0, 2 * (last - first) + 1, -(-(2 * (last - first) + 1) // MOST_LOOKS))
        try:
            curve = number(value, clock)
            for frame in (first + i / 2 for i in halves):
                if not low <= (found := number_at(curve, clock.time(frame))) <= high:
                    raise _outside(found, frame, low, high)
        except (UsageError, AssertionError):  # told elsewhere
            return value
        return value

    return AfterValidator(check)


def _outside(found: float, frame: float, low: float, high: float) -> PydanticCustomError:
    usual = "180, which film cameras have" if high > 0.0 else "-90"
    fact = f"is {found:.4g} at frame {frame:g}; it must stay from {low:g} to {high:g} degrees. Write {usual}."
    return PydanticCustomError("bad_curve", "{fact}", {"fact": fact})


class ShutterDocument(Document):
    """Angles in degrees."""

    angle: Annotated[NumberField, _between(0.0, 360.0)] = 180.0
    phase: Annotated[NumberField, _between(-360.0, 0.0)] | None = None

    def build(self, clock: Clock) -> Shutter:
        phase = None if self.phase is None else number(self.phase, clock, DEGREE)
        return Shutter(number(self.angle, clock, DEGREE), phase)


LayerName = Annotated[str, one_of(AOVS, "layer")]
Precision = Literal["half", "float"]

LayersField = Annotated[
    Annotated[dict[LayerName, Precision], Tag("with precision")] | Annotated[list[LayerName], Tag("by name")],
    Discriminator(lambda value: "with precision" if isinstance(value, dict) else "by name"),
]
"""`[velocity, noise]`, or `{velocity: half, position: half}`."""


@dataclass(frozen=True)
class PictureLayers:
    """Those of a picture that it says something of, by name half or float, in the order of `AOVS`."""

    precision: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, said: Mapping[str, str] | list[str]) -> PictureLayers:
        precision = said if isinstance(said, Mapping) else {name: AOVS[name].precision for name in said}
        return cls(tuple((name, precision[name]) for name in AOVS if name in precision))

    def with_(self, *names: str) -> PictureLayers:
        """With others beside them, as precise as they usually are."""
        return PictureLayers.of({**{name: AOVS[name].precision for name in names}, **dict(self.precision)})

    @property
    def extra(self) -> tuple[str, ...]:
        """The names of those that a picture does not have anyhow."""
        return tuple(name for name, _ in self.precision if name in EXTRA)
