"""The command `flowsculpt`. A fault is one line, and the exit code says of which kind it is.

The module of a command is imported when the command is called. Help lists commands by their panels, and in
each panel as plug-ins list them, those of the core first.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from flowsculpt.pipeline.cli.options import (
    INTERRUPTED,
    REFERENCE,
    CommonOptions,
    parameters_of,
    require_command,
    require_one_of,
    require_options,
    require_readable,
    with_options,
    with_parameters,
)
from flowsculpt.pipeline.cli.output import out, print_error, print_warning
from flowsculpt.pipeline.errors import FlowsculptError, MachineError
from flowsculpt.pipeline.plugin import Command, fault_of_plugin, named, plugins
from flowsculpt.render.base.foreign_code import reason_of_foreign
from flowsculpt.render.base.python_process import ENDING, interrupt_once
from flowsculpt.render.base.render_errors import REMEDIES
from flowsculpt.render.base.standard_streams import READER_LEFT, OutputError, discard_output

HELP = """Films of shapes that flow like putty, from a shot file to a finished film.

{openings} `flowsculpt COMMAND --help` explains a command by examples."""

EPILOG = (
    "Exit codes: 0 done · 1 some frames failed, the rest done · 2 bad usage or shot · 3 a missing input · "
    "4 the environment (disk full, no permission, renderer unusable) · 130 interrupted. "
    "What is done stays done: run again to go on."
)

PANELS = ("Write shots", "Render", "Look", "Deliver", "Maintain")
"""The parts of the help in their order; others follow."""

EXPORT = Command("", "Write a shot or an edit for other programs, in one of their formats.", "Deliver")
"""The command `export`: its formats come from plug-ins, and each is a command of its own."""


def all_commands() -> dict[str, Command]:
    """Return the commands of the core and of plug-ins by name, in the order of the help.

    Raises MachineError where the installation does not name those of the core.
    """
    if "flowsculpt" not in plugins().loaded:
        raise MachineError(
            "flowsculpt was installed from an earlier version of this code, and its commands are not "
            "registered; install it again: make setup in a checkout, else as docs/your-show.md says"
        )
    commands = {}
    for words, command in plugins().commands.items():
        name, _, form = words.partition(" ")
        commands[name] = EXPORT if form else command
    return dict(sorted(commands.items(), key=lambda item: _place(item[1].panel)))


def _place(panel: str) -> int:
    return PANELS.index(panel) if panel in PANELS else len(PANELS)


def _formats() -> dict[str, Command]:
    """Return the formats of `export` by name."""
    exports = ((words.partition(" ")[2], command) for words, command in plugins().commands.items())
    return {form: replace(command, panel="Formats") for form, command in exports if form}


def command_words() -> list[str]:
    """Return what calls each command, in the order of the help: its name, or `export FORMAT`."""
    formats = [f"export {form}" for form in _formats()]
    return [words for name in all_commands() for words in (formats if name == "export" else [name])]


def click_commands() -> Iterator[tuple[str, Any]]:
    """Yield all commands as click has them, and what calls each; first the command line, which nothing does.

    `export` is among them besides its formats. Those of plug-ins that do not load are left out.
    """
    yield "", typer.main.get_command(command_line())
    for words in ("export", *command_words()):
        with suppress(MachineError):
            yield words, command_named(words)


class _WithoutTypes:
    """Leaves the types of arguments and flags out of the help, such as `<list[str]>` and `<bool>`."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]  # of the command mixed in
        for param in params:
            if isinstance(param, TyperArgument) or getattr(param, "is_flag", False):
                param.display_type_rich = lambda ctx: None
        return params

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from typer import rich_utils  # takes time to import

        rich_utils.MAX_WIDTH = out.options.max_width if out.file.isatty() else 160
        super().format_help(ctx, formatter)  # type: ignore[misc]  # of the command mixed in


class _Command(_WithoutTypes, TyperCommand):
    """A command of the command line."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        require_options(args, {name for param in self.params for name in param.opts})
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        _handle_signals(_end_at_once, interrupt_once)
        return super().invoke(ctx)


class _Commands(_WithoutTypes, TyperGroup):
    """Imports a command when it is called; until then a placeholder stands for it."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        require_command(args[0], all_commands())
        name, _, rest = super().resolve_command(ctx, args)
        return name, command_named(str(name)), rest


class _Formats(_WithoutTypes, TyperGroup):
    """The formats of `export`, imported as commands are."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        fact = f"{args[0]!r} is not a format to export, which comes first."
        require_one_of(args[0], self.commands, fact, within="flowsculpt export ")
        return args[0], command_named(f"export {args[0]}"), args[1:]


def command_named(words: str) -> Any:
    """Return a command, or `export FORMAT`, with its options, as click has it."""
    name, _, form = words.partition(" ")
    if words == "export":
        return typer.main.get_command(_group(_Formats, _formats(), name="export", help=EXPORT.summary))
    command = plugins().commands[words]
    try:
        function = named(command.function)
    except Exception as error:  # a stranger's module may raise anything
        if command.function.startswith("flowsculpt."):
            raise
        raise MachineError(f"{words}: its plug-in does not load: {reason_of_foreign(error)}") from error
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    text = function.__doc__ or command.summary  # PYTHONOPTIMIZE=2 strips docstrings
    alone.command(form or name, cls=_Command, help=_unwrapped(text), epilog=REFERENCE)(with_options(function))
    return typer.main.get_command(alone)


def _group(kind: type[TyperGroup], commands: Mapping[str, Command], **settings: Any) -> typer.Typer:
    """Return a command line of placeholders for commands, as the help lists them."""
    app = typer.Typer(
        cls=kind, no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False, **settings
    )
    for name, command in commands.items():
        app.command(name, help=command.summary, rich_help_panel=command.panel)(lambda: None)
    app.callback()(lambda: None)
    return app


def _unwrapped(text: str) -> str:
    """Return a docstring with each paragraph in one line, for the help to wrap."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


VERSION = f"flowsculpt {version('flowsculpt')}"


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(VERSION)
        raise typer.Exit


@dataclass(frozen=True)
class _Options(CommonOptions):
    version_: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False


def _before_the_command(ctx: typer.Context, version_: bool, **given: Any) -> None:
    ctx.obj = CommonOptions(**given)
    for fault in plugins().faults:
        print_warning(fault)


def command_line() -> typer.Typer:
    """Return the command line with all commands, in the order of the help."""
    commands = all_commands()
    openings = " ".join(command.opening for command in commands.values() if command.opening)
    text = _unwrapped(HELP.format(openings=openings))
    app = _group(_Commands, commands, name="flowsculpt", help=text, epilog=EPILOG)
    app.callback()(with_parameters(_before_the_command, parameters_of(_Options)))
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


def _end_at_once(number: int, frame: FrameType | None) -> None:
    """End this process, in which no command has begun: imports may take an interrupt for a fault."""
    os._exit(INTERRUPTED)


def _handle_signals(before: Any, handler: Any) -> None:
    """Give `handler` the signals that `before` had; for None, all that are not ignored."""
    for number in ENDING:
        had = signal.getsignal(number)
        if had == before or (before is None and had != signal.SIG_IGN):
            signal.signal(number, handler)


def main() -> None:
    """Run the command line. Errors that a user can mend are told without a traceback."""
    _handle_signals(None, _end_at_once)  # some are ignored under nohup, and in the background of a script
    keep_freed_memory()
    name_a_home()
    try:
        require_readable(*sys.argv[1:])
        if sys.argv[1:] == ["--version"]:
            typer.echo(VERSION)  # imports no plug-in
            return
        command_line()()
    except KeyboardInterrupt:  # before a command has begun
        sys.exit(INTERRUPTED)
    except OutputError as error:
        discard_output()
        if error.exit_code != READER_LEFT:
            print_error(str(error))
        sys.exit(error.exit_code)
    except FlowsculptError as error:
        print_error(str(error))
        sys.exit(error.exit_code)
    except BaseException as error:
        if isinstance(error, OSError) and error.errno in REMEDIES:
            file = Path(os.fsdecode(error.filename or "a file"))  # closing one has no name
            print_error(str(MachineError.of_path(file, error, "used")))
            sys.exit(MachineError.exit_code)
        if isinstance(error.__cause__, KeyboardInterrupt):  # which Python 3.11 wraps while it makes a class
            sys.exit(INTERRUPTED)
        if isinstance(error, SystemExit) or (fault := fault_of_plugin(error)) is None:
            raise
        print_error(str(fault))
        sys.exit(fault.exit_code)
