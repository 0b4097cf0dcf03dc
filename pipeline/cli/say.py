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


def duration(seconds: float) -> str:
    """`40 s`, `12 min`, `3 h 05 min`."""
    minutes = round(seconds / 60.0)
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def complain(words: str) -> None:
    err.print(words, style="red", markup=False)


def warn(words: str) -> None:
    err.print(words, style="yellow", markup=False)
