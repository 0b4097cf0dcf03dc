"""The command `flowsculpt`: one line for what goes wrong, and an exit code that says of what kind it is."""

from __future__ import annotations

import inspect
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, get_args

import typer

from pipeline.cli.heap import keep_freed_memory
from pipeline.cli.options import (
    Cores,
    DryRun,
    Json,
    Nice,
    NoProgress,
    ProfileName,
    Root,
    Timeout,
    remember,
    with_common,
)
from pipeline.cli.output import complain
from pipeline.errors import FlowsculptError
from render.base.errors import RenderError

EPILOG = (
    "Exit codes: 0 done · 1 some frames failed, the rest done · 2 bad usage or shot · 3 a missing input · "
    "4 the environment (disk full, no permission, renderer unusable) · 130 interrupted. "
    "What is done stays done: run again to go on."
)

COMMANDS = (
    "new",
    "validate",
    "simulate",
    "render",
    "stills",
    "film",
    "turntable",
    "deliver",
    "preview",
    "curves",
    "wedge",
    "publish",
    "versions",
    "sheet",
    "figures",
    "review",
    "export",
    "resample",
    "flows",
    "schema",
    "status",
    "report",
    "why",
    "verify",
    "clean",
    "doctor",
)
"""Commands in the order of the help: each is a function in the module of its name in `commands/`."""


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flowsculpt {version('flowsculpt')}")
        raise typer.Exit


def before_the_command(
    ctx: typer.Context,
    json_: Json = False,
    no_progress: NoProgress = False,
    cores: Cores = None,
    dry_run: DryRun = False,
    root: Root = None,
    timeout: Timeout = None,
    nice: Nice = None,
    profile: ProfileName = None,
    version_: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    remember(ctx, json_, no_progress, cores, dry_run, root, timeout, nice, profile)


def command_line(words: Sequence[str]) -> typer.Typer:
    """The command line that understands `words`: with the command that they name or, for help, with all."""
    app = typer.Typer(
        name="flowsculpt",
        help="Flow sculpture films: shapes that flow like putty, from a shot file to a finished film.",
        epilog=EPILOG,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        add_completion=False,
    )
    app.callback()(before_the_command)
    named = next(_arguments(words), "")
    for name in [named] if named in COMMANDS else COMMANDS:
        module = import_module(f"pipeline.cli.commands.{name}")
        app.command()(with_common(getattr(module, name)))
    return app


def _arguments(words: Sequence[str]) -> Iterator[str]:
    """Words that are neither options nor values of those that stand before a command; none after --help."""
    rest, takes_a_value = iter(words), set(_taking_a_value())
    for word in rest:
        if word == "--help":
            return
        if word in takes_a_value:
            next(rest, None)
        elif not word.startswith("-"):
            yield word


def _taking_a_value() -> Iterator[str]:
    """The options before a command that do."""
    for parameter in inspect.signature(remember, eval_str=True).parameters.values():
        kind, *options = get_args(parameter.annotation) or (bool,)
        for option in options if kind is not bool else ():
            written = (option.default, *(option.param_decls or ()))  # typer takes the first for a default
            yield from [w for w in written if isinstance(w, str)] or [f"--{parameter.name}"]


def main() -> None:
    """Run the command line; never shows a traceback for what a user can mend."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what a farm or a service manager sends
    keep_freed_memory()
    try:
        command_line(sys.argv[1:])()
    except (FlowsculptError, RenderError) as error:
        complain(str(error))
        sys.exit(error.exit_code)
