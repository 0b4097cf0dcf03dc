"""What hands and devices do, as named controls with numbers, and the values of a shot that they move.

Most controls go from 0 to 1. A binding takes 0 to its low end and 1 to its high end, and goes on beyond.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from flowsculpt import UsageError
from flowsculpt.pipeline.plugins.preview.text_edits import Where

POINTER = ("pointer x", "pointer y", "pen pressure")
"""Controls of the pointer over the picture: from left to right, from bottom to top, and of a pen."""

LEARN = "learn"  # in place of a control: the next one that moves, of all but the pointer

TOUCH = "touch"  # the handle, slider or field of the value itself

SOURCES = (
    (TOUCH, "handle, slider"),
    ("pointer x", "pointer, across"),
    ("pointer y", "pointer, upwards"),
    ("pen pressure", "pressure of a pen"),
    (LEARN, "learn: move a control"),
)
"""Controls that are always in the lists of the page, with their words there."""

MOST_CONTROLS = 1000  # that are remembered for the lists of the page

Moved = list[tuple[str, float]]
"""Names of controls and their numbers."""

NOTE_OFF, NOTE_ON, CONTROL_CHANGE, PITCH_BEND = 0x8, 0x9, 0xB, 0xE
"""Messages of MIDI 1.0 by the upper half of their first byte."""


def midi_controls(message: Sequence[float]) -> Moved:
    """Return what a message of MIDI moves: a control, the bend, or a note with its velocity."""
    if len(message) != 3:
        return []
    status, first, second = (int(byte) for byte in message)
    kind = status >> 4
    if kind == CONTROL_CHANGE:
        return [(f"midi cc {first}", second / 127.0)]
    if kind == PITCH_BEND:
        return [("midi bend", (first + (second << 7)) / 16383.0)]
    if kind == NOTE_ON and second:
        return [("midi note", first / 127.0), ("midi velocity", second / 127.0)]
    if kind in (NOTE_ON, NOTE_OFF):
        return [("midi velocity", 0.0)]
    return []


def pointer_controls(message: Sequence[float]) -> Moved:
    """Return what a pointer moves: places over the picture, and the pressure of a pen, each from 0 to 1."""
    return list(zip(POINTER, map(float, message), strict=False))


def gamepad_controls(message: Sequence[float]) -> Moved:
    """Return what a stick or button of a gamepad moves: its kind (0 stick, 1 button), number, and value."""
    if len(message) != 3:
        return []
    kind, number, value = message
    if kind:
        return [(f"gamepad button {int(number)}", float(value))]
    return [(f"gamepad stick {int(number)}", 0.5 + 0.5 * float(value))]


DECODERS = {"midi": midi_controls, "pointer": pointer_controls, "gamepad": gamepad_controls}


@dataclass
class Binding:
    """A control that moves a number of an armed value: TOUCH, LEARN, or the name of a control."""

    control: str
    low: float
    high: float

    def value(self, number: float) -> float:
        """Return what the number of a control means."""
        return self.low + number * (self.high - self.low)


@dataclass(eq=False)
class Armed:
    """A value that is recorded, with a binding for each of its numbers."""

    where: Where
    bindings: list[Binding]

    @classmethod
    def of(cls, where: Where, row: Sequence[float], bounds: tuple[float, float], unit: str) -> Armed:
        """Return a value that its own handle moves, with a range around what it is now."""
        bindings = []
        for number in row:
            reach = max(abs(number), 90.0 if unit == "degrees" else 1.0)
            low, high = max(bounds[0], number - reach), min(bounds[1], number + reach)
            bindings.append(Binding(TOUCH, round(low, 4), round(high, 4)))
        return cls(where, bindings)

    def bind(self, part: int, control: str, low: float, high: float) -> None:
        """Bind one of its numbers. Raises UsageError where it has no such number, or a range has no end."""
        if not 0 <= part < len(self.bindings):
            raise UsageError(f"the value has {len(self.bindings)} numbers; bind one of them")
        if not (math.isfinite(low) and math.isfinite(high)):
            raise UsageError("the ends of a range are numbers, such as 0 and 1")
        self.bindings[part] = Binding(control, low, high)

    @property
    def data(self) -> dict[str, Any]:
        return {"where": self.where, "parts": [asdict(binding) for binding in self.bindings]}

    @property
    def source(self) -> str:
        """What moves it, in words."""
        return ", ".join(dict.fromkeys(binding.control for binding in self.bindings))


@dataclass(eq=False)
class Controls:
    """Armed values, and the controls that were heard of."""

    armed: dict[Where, Armed] = field(default_factory=dict)
    known: dict[str, float] = field(default_factory=dict)

    def heard(self, moved: Moved) -> bool:
        """Note what was moved, and bind what is to learn; return whether a list of the page changes."""
        changed = False
        for name, number in moved:
            if name not in self.known and len(self.known) < MOST_CONTROLS:
                changed = True
                self.known[name] = number
            for armed in self.armed.values():
                for binding in armed.bindings:
                    if binding.control == LEARN and name not in POINTER:
                        binding.control, changed = name, True
        return changed

    def listed(self) -> list[tuple[str, str]]:
        """Return the controls that a value can be bound to, each with its words in the lists of the page."""
        bound = {binding.control for armed in self.armed.values() for binding in armed.bindings}
        others = sorted((self.known.keys() | bound) - dict(SOURCES).keys())
        return [*SOURCES, *((name, name) for name in others)]

    def moves(self, name: str, number: float) -> list[tuple[Where, int, float]]:
        """Return the numbers of armed values that a control sets: path, index, and number."""
        return [
            (armed.where, part, binding.value(number))
            for armed in self.armed.values()
            for part, binding in enumerate(armed.bindings)
            if binding.control == name
        ]
