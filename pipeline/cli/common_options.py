"""The options of every command, and how a function that takes options becomes a command."""

from __future__ import annotations

import copy
import functools
import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from pipeline.cli.options import Common
from pipeline.cli.other_words import require_readable, require_readable_path
from pipeline.cli.output import print_error, print_warning, tell_of_store
from pipeline.production.store.paths import require_store
from pipeline.production.store.remote_store import VARIABLE, remote_stores
from render.mitsuba.engine import available_cores

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

_common = functools.partial(typer.Option, rich_help_panel="Options of every command")

REFERENCE = "Options of every command (-j, --json, --dry-run, …): flowsculpt --help"
"""The line in the help of each command that stands for the common options, which the help lists once."""


@dataclass(frozen=True)
class CommonOptions:
    """The common options as typed, before or after the command; what is not given is empty."""

    json_: Annotated[
        bool, _common("--json", help="Answer in JSON on standard output; messages go to standard error.")
    ] = False
    no_progress: Annotated[bool, _common("--no-progress", help="Show no progress.")] = False
    cores: Annotated[int | None, _common("-j", min=1, metavar="N", help="Use N cores. Default: all.")] = None
    dry_run: Annotated[bool, _common("--dry-run", help="Say what would be done, and do nothing.")] = False
    root: Annotated[
        Path | None,
        _common("--root", metavar="DIR", help="Write outputs and the store below DIR. Default: this folder."),
    ] = None
    timeout: Annotated[
        float | None,
        _common(
            "--timeout",
            min=0.01,
            metavar="MINUTES",
            help="End a job that shows no sign of life for so long, and try it again. Default: 30.",
        ),
    ] = None
    nice: Annotated[
        int | None,
        _common(
            "--nice",
            min=0,
            max=19,
            metavar="N",
            help="Lower the priority of all processes: 10 is usual, 19 the lowest.",
        ),
    ] = None
    store: Annotated[
        str | None,
        _common(
            "--store",
            metavar="URL",
            envvar=VARIABLE,
            help="Share what is made through this store too: s3://BUCKET/PREFIX, or a folder on a file "
            "share; see docs/farm.md.",
        ),
    ] = None
    profile: Annotated[
        str | None,
        _common(
            "--profile",
            metavar="NAME|DIR",
            envvar="FLOWSCULPT_PROFILE",
            help="Where jobs run: local, slurm, another folder in profiles/, or any path; see docs/farm.md.",
        ),
    ] = None
    wait: Annotated[
        bool,
        _common("--wait", help="Wait for another run of the same shot and quality. Default: refuse to run."),
    ] = False

    def resolved(self, before: CommonOptions) -> Common:
        """Return what holds for a command; `before` are the options given before its name, which yield."""
        from pipeline.production.planning.profile import Profile

        given = CommonOptions(*(getattr(self, f.name) or getattr(before, f.name) for f in fields(self)))
        if given.nice:
            os.nice(given.nice)  # processes that this one starts inherit it
        progress = not (given.no_progress or given.json_)
        profile = Profile.named(given.profile) if given.profile else Profile.local()
        if given.profile and (own := profile.hides):
            print_warning(
                f"--profile {given.profile}: the shipped profile; {own} here is used by --profile {own}"
            )
        root = (given.root or Path()).resolve()
        require_readable(str(root))
        require_readable_path(str(root))
        require_store(root)
        if given.store:
            os.environ[VARIABLE] = remote_stores().checked(given.store)  # so do they
            tell_of_store(progress)
        return Common(
            json=given.json_,
            progress=progress,
            cores=given.cores or available_cores(),
            dry_run=given.dry_run,
            root=root,
            patience=None if given.timeout is None else 60.0 * given.timeout,
            profile=profile,
            wait=given.wait,
        )


def with_options(function: Callable[..., None]) -> Callable[..., None]:
    """Make a function a command: its parameter `common` stands for the common options, and a parameter whose
    type is a dataclass for the options that are its fields."""
    own = inspect.signature(function, eval_str=True).parameters
    groups = {
        name: p.annotation for name, p in own.items() if is_dataclass(p.annotation) and name != "common"
    }
    plain = [p for name, p in own.items() if name not in {"common", *groups}]
    common = [_hidden(p) for p in parameters_of(CommonOptions)]

    @functools.wraps(function)
    def command(ctx: typer.Context, **values: Any) -> None:
        def taken(options: Any) -> Any:
            return options(**{f.name: values.pop(f.name) for f in fields(options)})

        given = taken(CommonOptions)
        values |= {name: taken(options) for name, options in groups.items()}
        try:
            function(given.resolved(ctx.obj or CommonOptions()), **values)
        except KeyboardInterrupt:
            print_error("interrupted; what is done stays done, run again to go on")
            raise typer.Exit(INTERRUPTED) from None

    inner = [p for options in groups.values() for p in parameters_of(options)]
    return with_parameters(command, [*plain, *inner, *common])


def parameters_of(options: Any) -> list[inspect.Parameter]:
    """Return the fields of a dataclass of options as parameters of a command."""
    types, kind = get_type_hints(options, include_extras=True), inspect.Parameter.KEYWORD_ONLY
    return [
        inspect.Parameter(f.name, kind, default=f.default, annotation=types[f.name]) for f in fields(options)
    ]


def _hidden(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return an option that works and is not in the help."""
    option = copy.copy(parameter.annotation.__metadata__[0])
    option.hidden = True
    return parameter.replace(annotation=Annotated[parameter.annotation.__origin__, option])


def with_parameters(
    function: Callable[..., None], parameters: Sequence[inspect.Parameter]
) -> Callable[..., None]:
    """Give a function a context and these parameters, as typer reads them."""
    context = inspect.Parameter("ctx", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    own = [context, *(p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters)]
    function.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]  # inspect reads it
    function.__annotations__ = {p.name: p.annotation for p in own}
    return function
