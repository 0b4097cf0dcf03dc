"""What the values of a shot are called where people edit them, by their paths."""

from __future__ import annotations

from typing import NamedTuple

from flowsculpt.pipeline.plugins.preview.text_edits import Where

_ENTRIES = {"resample": "resampling", "smooth": "smoothing"}


class ValueTitle(NamedTuple):
    """Names of a value.

    group    the path of the flow, the subject or the entry of the shot that it is in, with dots
    title    the group in words, such as vortex
    note     what the group is, such as: flow 1, in sum
    name     the value within its group, such as strength
    words    the value among all others, such as: vortex 0.1 strength
    is_flow  True if the group is a flow
    """

    group: str
    title: str
    note: str
    name: str
    words: str
    is_flow: bool


def value_title(where: Where) -> ValueTitle:
    """Return the names of the value at a path."""
    start = _flows_at(where)
    group = _group_of(where, start)
    rest = [_in_words(part) for part in where[len(group) :]]
    numbers = ".".join(str(part) for part in group if isinstance(part, int)) if start >= 0 else ""
    if start >= 0:
        title, notes = _in_words(group[-1]), [f"flow {numbers}"]
        around = [
            str(part)
            for before, part in zip(group[start + 1 :], group[start + 2 : -1], strict=False)
            if isinstance(before, int)
        ]
        notes += [f"of {where[1]}"] if start else []
        notes += [f"in {', '.join(around)}"] if around else []
    elif where[0] == "subjects":
        title, notes = _in_words(group[1]), ["subject"]
    else:
        title, notes = _ENTRIES.get(str(where[0]), str(where[0])), []
    path, words = ".".join(map(str, group)), " ".join(filter(None, (title, numbers, *rest)))
    return ValueTitle(path, title, ", ".join(notes), " › ".join(rest) or title, words, start >= 0)


def _flows_at(where: Where) -> int:
    """Return the place in a path of the list of flows, of the shot or a subject; -1 for other values."""
    if where[0] == "flows":
        return 0
    return 2 if where[0] == "subjects" and where[2:3] == ("flows",) else -1


def _group_of(where: Where, start: int) -> Where:
    """Return the path of the group of a value whose flows begin at `start`: its innermost flow."""
    if start < 0:
        return where[: 2 if where[0] == "subjects" else 1]
    ends = [
        place + 2
        for place in range(start + 1, len(where) - 1)
        if isinstance(where[place], int) and isinstance(where[place + 1], str) and where[place - 1] != "keys"
    ]
    return where[: min(ends[-1] if ends else start + 2, len(where) - 1)]


def _in_words(part: object) -> str:
    return str(part).replace("_", " ")
