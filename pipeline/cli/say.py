"""Words to the user: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
from typing import Any

from rich.console import Console

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


def answer(words: str, facts: Any, as_json: bool) -> None:
    """The result of a command, for a person or for a program."""
    if as_json:
        out.print(json.dumps(facts, indent=2), markup=False)
    else:
        out.print(words, markup=False)


def complain(words: str) -> None:
    err.print(words, style="red", markup=False)
