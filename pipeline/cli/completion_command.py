"""The command `completion`, and the table by which a shell's Tab is answered."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt.pipeline.cli import completion as table
from flowsculpt.pipeline.cli.app import all_commands, command_line, command_named, command_words
from flowsculpt.pipeline.cli.options import Common, require_one_of
from flowsculpt.pipeline.cli.output import print_result
from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.user_cache import remove_unused
from flowsculpt.render.mitsuba.engine import VARIANTS
from flowsculpt.render.scene.render_quality import CONVENTIONS, QUALITIES

BASH = """\
_flowsculpt() {
    local IFS=$'\\n' line
    local -a found
    mapfile -t found < <(VARIABLE=bash "$1" "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    COMPREPLY=()
    for line in "${found[@]}"; do
        if [[ $line == FILES ]]; then
            compopt -o filenames
            COMPREPLY+=($(compgen -f -- "$([[ $2 == = ]] || printf %s "$2")"))
        else
            COMPREPLY+=("${line%%$'\\t'*}")
        fi
    done
}
complete -F _flowsculpt flowsculpt
"""

ZSH = """\
#compdef flowsculpt
_flowsculpt() {
    local line word
    local -a found described
    found=("${(@f)$(VARIABLE=zsh "${words[1]}" "${(@)words[2,CURRENT]}" 2>/dev/null)}")
    for line in $found; do
        word=${line%%$'\t'*}
        if [[ $line == FILES ]]; then
            _files
        else
            described+=("${word//:/\\:}:${${line#$word}#$'\t'}")
        fi
    done
    (( $#described )) && _describe flowsculpt described
}
if [[ $funcstack[1] == _flowsculpt ]]; then _flowsculpt "$@"; else compdef _flowsculpt flowsculpt; fi
"""

FISH = """\
function __flowsculpt_completions
    set -l typed (commandline -opc)
    for line in (env VARIABLE=fish $typed "$(commandline -ct)" 2>/dev/null)
        if test "$line" = FILES
            __fish_complete_path (commandline -ct)
        else
            printf '%s\\n' $line
        end
    end
end
complete -c flowsculpt -f -a '(__flowsculpt_completions)'
"""

SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}


def completion(
    common: Common,
    shell: Annotated[str, typer.Argument(metavar="|".join(SCRIPTS), help="The shell that you type in.")],
) -> None:
    """Print the script by which Tab completes commands, options, shots, edits, flows, looks and qualities.

    Bash: write `source <(flowsculpt completion bash)` into ~/.bashrc. Zsh: the same with zsh into ~/.zshrc,
    after compinit. Fish: run `flowsculpt completion fish > ~/.config/fish/completions/flowsculpt.fish`.
    """
    require_one_of(shell, SCRIPTS, f"{shell!r} is not a shell that is known here.")
    if table.current_commands() is None:
        write_table()
    script = SCRIPTS[shell].replace("VARIABLE", table.VARIABLE).replace("FILES", table.FILES)
    print_result(script.rstrip(), {"shell": shell, "script": script}, common.json)


def write_table() -> None:
    """Write the table of all commands, options and names. Ignore errors of the disk."""
    home = Path(__file__).parents[2]
    files = [*(home / "pipeline").rglob("*.py"), *(file for plugin in plugins() for file in plugin.files)]
    content = {
        "packages": table.packages(),
        "files": table.states([str(file) for file in files]),
        "commands": _commands(),
    }
    file = Path(table.table_file())
    remove_unused(file.parent)
    with suppress(MachineError, OSError), atomic_write(file, flush=False) as draft:
        draft.write_text(json.dumps(content), encoding="utf-8")


def _commands() -> dict[str, Any]:
    """Return options and words of commands by name, as `completions` takes them."""
    known = all_commands()
    first = [f"{name}\t{command.summary}" for name, command in known.items()]
    formats = [
        f"{words.partition(' ')[2]}\t{command.summary}"
        for words, command in plugins().commands.items()
        if words.startswith("export ")
    ]
    shared = _entry(typer.main.get_command(command_line()))
    found = {"": {**shared, "words": [first]}, "export": {"options": {}, "words": [formats]}}
    for words in command_words():
        with suppress(MachineError):  # a plug-in that does not load
            found[words] = _entry(command_named(words))
    return found


def _entry(command: Any) -> dict[str, Any]:
    shown = [param for param in command.params if not getattr(param, "hidden", False)]
    rows = [_kinds(param) for param in shown if param.param_type_name == "argument"]
    options = {
        word: [None if getattr(param, "is_flag", False) else _kinds(param), _first_line(param.help)]
        for param in shown
        if param.param_type_name == "option"
        for word in param.opts
    }
    return {"options": options, "words": rows}


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


def _presets(kind: str) -> list[str]:
    from flowsculpt.pipeline.shot.documents.shot_documents import PRESETS

    return list(PRESETS[kind])


def _flows() -> list[str]:
    from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS

    return list(FLOW_DOCUMENTS)


def _values() -> list[str]:
    return [f"{kind}={name}" for kind in ("look", "lights", "stage") for name in _presets(kind)]


_NAMED = {
    **dict.fromkeys(("FILE", "MESHFILE", "DIR", "FOLDER", "PLAN", "OUT", "IN"), lambda: [table.FILES]),
    **dict.fromkeys(("SHOT", "SHOT2"), lambda: [table.SHOTS]),
    "EDIT": lambda: [table.EDITS],
    "QUALITY": lambda: list(QUALITIES),
    "VARIANT": lambda: list(VARIANTS),
    "PROGRAM": lambda: list(CONVENTIONS),
    "FLOW": _flows,
    **dict.fromkeys(("LOOK", "LOOKS"), lambda: _presets("look")),
    "NAME=VALUE": _values,
}
"""What a word of a metavar stands for."""
