"""The command `flowsculpt`: one line for what goes wrong, and an exit code that says of what kind it is."""

from __future__ import annotations

import signal
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from pipeline.cli import ask, author, export, files, flows, make, preview, start
from pipeline.cli.options import Cores, DryRun, Json, NoProgress, ProfileName, Root, remember, with_common
from pipeline.cli.say import complain
from pipeline.errors import FlowsculptError
from render.errors import RenderError

EPILOG = (
    "Exit codes: 0 done · 1 some frames failed, the rest done · 2 bad usage or shot · 3 a missing input · "
    "4 the environment (disk full, no permission, renderer unusable) · 130 interrupted. "
    "What is done stays done: run again to go on."
)

app = typer.Typer(
    name="flowsculpt",
    help="Flow sculpture films: shapes that flow like putty, from a shot file to a finished film.",
    epilog=EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flowsculpt {version('flowsculpt')}")
        raise typer.Exit


@app.callback()
def before_the_command(
    ctx: typer.Context,
    json_: Json = False,
    no_progress: NoProgress = False,
    cores: Cores = None,
    dry_run: DryRun = False,
    root: Root = None,
    profile: ProfileName = None,
    version_: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    remember(ctx, json_, no_progress, cores, dry_run, root, profile)


for command in (
    author.new,
    start.validate,
    make.simulate,
    make.render,
    make.stills,
    make.film,
    make.turntable,
    preview.preview,
    preview.curves,
    files.resample,
    flows.flows,
    author.schema,
    ask.status,
    ask.doctor,
):
    app.command()(with_common(command))
app.add_typer(export.app, name="export")


def main() -> None:
    """Run the command line; never shows a traceback for what a user can mend."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what a farm or a service manager sends
    try:
        app()
    except (FlowsculptError, RenderError) as error:
        complain(str(error))
        sys.exit(error.exit_code)
