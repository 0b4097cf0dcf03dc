"""Which angles stand on a sheet, and what pictures are called by."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.production.request.turntable import Turntable

EIGHTHS, QUARTERS = 8, 4
"""Angles of a full turn. Objects are looked at from more sides than they are lit from."""


def key_numbers(table: Turntable, turns: Sequence[str], parts_of_object: int = EIGHTHS) -> list[int]:
    """The pictures nearest to equal parts of each turn; fewer where there are not as many."""
    parts = {"object": parts_of_object, "lights": QUARTERS}
    return [number for turn in turns for number in _spread(table.numbers(turn), parts[turn])]


def _spread(numbers: range, parts: int) -> list[int]:
    steps = dict.fromkeys(round(len(numbers) * i / parts) % len(numbers) for i in range(parts))
    return [numbers[step] for step in sorted(steps)]


def named(table: Turntable, number: int) -> tuple[str, str]:
    """What is turned in a picture, and how far: `object`, `45°`."""
    turn, numbers = next((t, table.numbers(t)) for t in ("object", "lights") if number in table.numbers(t))
    return turn, f"{round(360.0 * (number - numbers[0]) / table.frames, 1):g}°"
