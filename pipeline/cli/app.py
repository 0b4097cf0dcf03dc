"""The command `flowsculpt`. A fault is told in one line, and its kind by the exit code.

The module of a command is imported when the command is called. Help lists commands by the table below.
"""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from pipeline.cli.common_options import (
    REFERENCE,
    CommonOptions,
    parameters_of,
    with_options,
    with_parameters,
)
from pipeline.cli.other_words import require_command, require_options, require_readable
from pipeline.cli.output import print_error
from pipeline.cli.standard_streams import READER_LEFT, OutputError, discard_output
from pipeline.errors import FlowsculptError, MachineError
from render.base.atomic_write import REMEDIES, machine_error
from render.base.python_process import distrust_working_folder

HELP = """Films of shapes that flow like putty, from a shot file to a finished film.

`flowsculpt new --show my_show` writes a folder to work in. There, `flowsculpt preview A010_first`
draws its shot in seconds, and `flowsculpt film` renders its film. `flowsculpt COMMAND --help` explains a
command by examples."""

EPILOG = (
    "Exit codes: 0 done · 1 some frames failed, the rest done · 2 bad usage or shot · 3 a missing input · "
    "4 the environment (disk full, no permission, renderer unusable) · 130 interrupted. "
    "What is done stays done: run again to go on."
)

COMMANDS = {
    "Write shots": {
        "new": "Begin a shot, or a show: write files that are ready to render.",
        "validate": "Check shot files and report every error by file, line and column.",
        "flows": "List the flows, or the parameters of one.",
        "schema": "Print the JSON Schema by which editors complete and check shot files.",
    },
    "Render": {
        "simulate": "Simulate the mesh frames of shots.",
        "render": "Render frames of shots and assemble their movies.",
        "film": "Render every shot of an edit and cut them into a film.",
        "stills": "Write frames as PNG or JPEG, rendering what is missing.",
        "relight": "Change lights of finished frames by factors, without rendering.",
        "turntable": "Turn an object, then the lights around it, before the camera.",
        "wedge": "Render a shot in a grid of variations.",
        "task": "Do a part of a shot's plan, as a worker of a render manager.",
    },
    "Look": {
        "preview": "Draw a shot in seconds, without a path tracer; or follow its edits live.",
        "curves": "Draw everything in a shot that changes over time.",
        "figures": "Plot the measures of a shot's meshes over its frames.",
        "sheet": "Put frames of a shot on one contact sheet.",
        "review": "Write a page to look at shots frame by frame, and to write notes.",
        "notes": "List the notes that reviewers wrote about a shot.",
    },
    "Deliver": {
        "deliver": "Encode shots and films for review, editing, archive or web.",
        "export": "Write a render manager's job, or an editor's timeline.",
        "publish": "Freeze a rendered shot as its next version.",
        "versions": "List published versions.",
    },
    "Maintain": {
        "status": "List which frames are done, stale and missing.",
        "why": "Explain why a frame would be rendered again.",
        "report": "Show where the time of a run went.",
        "verify": "Check every stored file and make damaged ones again.",
        "push": "Upload stored files that the remote store lacks.",
        "clean": "Delete stored files that nothing needs.",
        "doctor": "Show what is installed, and what would make it faster.",
        "resample": "Resample one mesh file.",
    },
}
"""Commands with a line of help, by panel: each is a function in a module in `commands/`."""

SHARED_MODULES = {
    "curves": "figures",
    "film": "render",
    "flows": "schema",
    "report": "status",
    "simulate": "render",
    "stills": "render",
    "versions": "publish",
}
"""The modules of commands that share one; every other command has the module of its name."""


class _WithoutTypes:
    """Leaves the types of arguments and flags out of the help, such as `<list[str]>` and `<bool>`."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]  # of the command mixed in
        for param in params:
            if isinstance(param, TyperArgument) or getattr(param, "is_flag", False):
                param.display_type_rich = lambda ctx: None
        return params


class _Command(_WithoutTypes, TyperCommand):
    """A command of the command line."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        require_options(args, {name for param in self.params for name in param.opts})
        return super().parse_args(ctx, args)


class _Commands(_WithoutTypes, TyperGroup):
    """Imports a command when it is called; until then a placeholder stands for it."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        require_command(args[0], self.commands)
        name, _, rest = super().resolve_command(ctx, args)
        return name, command_named(str(name)), rest


def command_named(name: str) -> Any:
    """Return the command of a name, with its options, as click has it."""
    function = getattr(import_module(f"pipeline.cli.commands.{SHARED_MODULES.get(name, name)}"), name)
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    text = function.__doc__ or _summaries()[name]  # PYTHONOPTIMIZE=2 strips docstrings
    alone.command(name, cls=_Command, help=_unwrapped(text), epilog=REFERENCE)(with_options(function))
    return typer.main.get_command(alone)


def _summaries() -> dict[str, str]:
    """Return the line of help of each command."""
    return {name: summary for commands in COMMANDS.values() for name, summary in commands.items()}


def _unwrapped(text: str) -> str:
    """Return a docstring with each paragraph in one line, for the help to wrap."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flowsculpt {version('flowsculpt')}")
        raise typer.Exit


@dataclass(frozen=True)
class _Options(CommonOptions):
    version_: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False


def _before_the_command(ctx: typer.Context, version_: bool, **given: Any) -> None:
    ctx.obj = CommonOptions(**given)


def command_line() -> typer.Typer:
    """Return the command line with all commands."""
    app = typer.Typer(
        name="flowsculpt",
        cls=_Commands,
        help=_unwrapped(HELP),
        epilog=EPILOG,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        add_completion=False,
    )
    app.callback()(with_parameters(_before_the_command, parameters_of(_Options)))
    for panel, commands in COMMANDS.items():
        for name, summary in commands.items():
            app.command(name, help=summary, rich_help_panel=panel)(lambda: None)
    return app


def keep_freed_memory() -> None:
    """Let the C library keep some tens of megabytes that were freed, for the arrays of the next frame.

    glibc has the system map blocks of a megabyte one by one, and each page of a new one costs microseconds
    when it is first touched: a third of a million of them in an animatic of ten seconds. When a large block
    is freed (`mallopt(3)`, M_MMAP_THRESHOLD), glibc takes blocks of up to that size from its own heap from
    then on. So one is freed here, just below the 32 MiB that glibc heeds; it was never touched. Other C
    libraries lose nothing.
    """
    bytes(2**25 - 2**14)


def name_a_home() -> None:
    """Let accounts without a home, as containers and farms have, have one where nothing can be written.

    Libraries ask for it when they look for settings and caches, and some fail without an answer.
    """
    if not os.path.isabs(os.path.expanduser("~")):  # noqa: PTH111, PTH117  # Path.home() raises
        os.environ["HOME"] = os.devnull


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that interrupt a command: of a user, a farm or service manager, and a terminal that is closed."""


def _interrupt_once(number: int, frame: FrameType | None) -> None:
    """Interrupt this process, and let no further signal disturb how it ends its jobs and says so."""
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line. Errors that a user can mend are told without a traceback."""
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup, and in the background of a script
            signal.signal(number, _interrupt_once)
    keep_freed_memory()
    distrust_working_folder()
    name_a_home()
    try:
        require_readable(*sys.argv[1:])
        command_line()()
    except OutputError as error:
        discard_output()
        if error.exit_code != READER_LEFT:
            print_error(str(error))
        sys.exit(error.exit_code)
    except FlowsculptError as error:
        print_error(str(error))
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in REMEDIES:
            raise
        file = Path(os.fsdecode(error.filename or "a file"))  # closing one has no name
        print_error(str(machine_error(file, error, "used")))
        sys.exit(MachineError.exit_code)
