"""Words to the user: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
from typing import Any

import typer
from rich.console import Console

out = Console(highlight=False, emoji=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, emoji=False, soft_wrap=True)


def answer(words: str, facts: Any, as_json: bool) -> None:
    """The result of a command, for a person or for a program."""
    typer.echo(json.dumps(facts, indent=2) if as_json else words)


def complain(words: str) -> None:
    err.print(words, style="red", markup=False)


def warn(words: str) -> None:
    err.print(words, style="yellow", markup=False)


def duration(seconds: float) -> str:
    """`40 s`, `12 min`, `3 h 05 min`, `2 days 4 h`"""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 90:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes:02d} min"
    days, hours = divmod(hours, 24)
    return f"{days} days {hours} h"


def size(count: float) -> str:
    """`980 kB`, `1.2 GB`"""
    for unit, bytes_ in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= bytes_:
            return f"{count / bytes_:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"
