"""Write commands.md, the page of every command and its options, from the command line itself.

`make reference` runs it; a test holds the page to what the command line says.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from typer.main import get_command

from flowsculpt.pipeline.cli.app import EPILOG, all_commands, command_line, command_named, command_words

PAGE = Path(__file__).with_suffix(".md")

INTRODUCTION = f"""# Every command

All commands with their options, from the command line itself; `make reference` writes this page, and
`flowsculpt COMMAND --help` says the same.

{EPILOG}"""

SHARED = "Options of every command"


def page() -> str:
    """Return the whole page."""
    shared = get_command(command_line()).params
    lines = [INTRODUCTION, f"\n## {SHARED}\n\nThey stand before the command or after it.", *_options(shared)]
    panels = {name: command.panel for name, command in all_commands().items()}
    for panel, group in groupby(command_words(), key=lambda words: panels[words.partition(" ")[0]]):
        lines.append(f"\n## {panel}")
        for words in group:
            lines += _command(words)
    return "\n".join(lines) + "\n"


def _command(name: str) -> Iterator[str]:
    command = command_named(name)
    own = [param for param in command.params if getattr(param, "rich_help_panel", None) != SHARED]
    arguments = [param for param in own if param.param_type_name == "argument"]
    words = " ".join(param.metavar or param.name.upper() for param in arguments)
    yield f"\n### {name}\n\n```text\nflowsculpt {name} {words}".rstrip() + "\n```\n"
    yield command.help
    yield from _options(own)


def _options(params: Iterable[Any]) -> Iterator[str]:
    """Yield a table of arguments and options, if there are any."""
    rows = [(_written(param), _cell(param.help or "")) for param in params if param.name != "help"]
    if rows:
        yield from ("", "| option | |", "|---|---|")
        yield from (f"| {written} | {text} |" for written, text in rows)


def _written(param: Any) -> str:
    """Return a parameter as it is typed."""
    if param.param_type_name == "argument":
        return f"`{_cell(param.metavar or param.name.upper())}`"
    value = "" if param.is_flag else f" {param.metavar or param.name.upper()}"
    return ", ".join(f"`{option}{_cell(value)}`" for option in param.opts)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
