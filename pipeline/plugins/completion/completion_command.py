"""The command `completion`, and the table by which a shell's Tab is answered."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt.api import plugins
from flowsculpt.api.commands import click_commands, print_result, require_one_of
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.frames import QualityName
from flowsculpt.api.options import Common
from flowsculpt.api.shots import FLOW_DOCUMENTS, PRESETS
from flowsculpt.pipeline.plugins.completion import tab_answers as table

SHELLS = ("bash", "zsh", "fish")


def completion(
    common: Common,
    shell: Annotated[str, typer.Argument(metavar="|".join(SHELLS), help="The shell that you type in.")],
) -> None:
    """Print the script by which Tab completes commands, options, shots, edits, flows, looks and qualities.

    Bash: write `source <(flowsculpt completion bash)` into ~/.bashrc. Zsh: the same with zsh into ~/.zshrc,
    after compinit. Fish: write what `flowsculpt completion fish` prints to
    ~/.config/fish/completions/flowsculpt.fish.
    """
    require_one_of(shell, SHELLS, f"{shell!r} is not a shell that is known here.")
    if table.current_commands() is None:
        write_table()
    script = Path(__file__).with_name(f"completion.{shell}").read_text(encoding="utf-8")
    print_result(script.rstrip(), {"shell": shell, "script": script}, common.json)


def write_table() -> None:
    """Write the table of all commands, options and names. Ignore errors of the disk."""
    home = Path(__file__).parents[3]
    files = [*(home / "pipeline").rglob("*.py"), *(file for plugin in plugins() for file in plugin.files)]
    content = {
        "packages": table.packages(),
        "files": table.states([str(file) for file in files]),
        "commands": {words: _entry(command) for words, command in click_commands()},
    }
    CachedAnswer(Path(table.table_file())).store_alone(content)


def _entry(command: Any) -> dict[str, Any]:
    """Return options and words of a command of click, as `completions` takes them."""
    shown = [param for param in command.params if not getattr(param, "hidden", False)]
    rows = [_kinds(param) for param in shown if param.param_type_name == "argument"]
    options = {
        word: [None if getattr(param, "is_flag", False) else _kinds(param), _first_line(param.help)]
        for param in shown
        if param.param_type_name == "option"
        for word in param.opts
    }
    inner = getattr(command, "commands", {}).items()  # of a group
    words = [[f"{name}\t{each.help}" for name, each in inner]] if inner else rows
    return {"options": options, "words": words}


def _first_line(text: str | None) -> str:
    return (text or "").partition(". ")[0].removesuffix(".")


def _kinds(param: Any) -> list[str]:
    """Return the kinds of words that a parameter takes, by its metavar: `SHOT|FILE`, or choices: `y|z`."""
    found = list[str]()
    for word in re.split(r"[|, ]", (param.metavar or "").rstrip(".…")):
        if word in _NAMED:
            found += _NAMED[word]()
        elif re.fullmatch(r"[a-z][a-z0-9_]*", word):
            found.append(word)
    about = (param.help or "").lower()
    found += [table.SHOTS] if "shots/" in about else []
    found += [table.EDITS] if table.SHOTS in found and "edit" in about else []
    return list(dict.fromkeys(found))


def _values() -> list[str]:
    return [f"{kind}={name}" for kind in ("look", "lights", "stage", "set") for name in PRESETS[kind]]


_NAMED = {
    **dict.fromkeys(("FILE", "MESHFILE", "DIR", "FOLDER", "PLAN", "OUT", "IN"), lambda: [table.FILES]),
    **dict.fromkeys(("SHOT", "SHOT2"), lambda: [table.SHOTS]),
    "EDIT": lambda: [table.EDITS],
    "QUALITY": lambda: list(QualityName.names()),
    "FLOW": lambda: list(FLOW_DOCUMENTS),
    **dict.fromkeys(("LOOK", "LOOKS"), lambda: list(PRESETS["look"])),
    "NAME=VALUE": _values,
}
"""What a word of a metavar stands for."""
