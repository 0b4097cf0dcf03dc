"""Options that every command takes, before the command's name or after it."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.output import complain
from pipeline.production.execution.watchdog import PATIENCE
from pipeline.production.planning.profile import Profile
from render.mitsuba.engine import VARIANTS, available_cores
from render.scene.quality import QUALITIES

INTERRUPTED = 130

_PANEL = "Options of every command"


@dataclass(frozen=True)
class Common:
    """What the common options say."""

    json: bool
    progress: bool
    cores: int
    dry_run: bool
    root: Path
    patience: float
    profile: Profile


Json = Annotated[
    bool,
    typer.Option("--json", help="Answer in JSON; messages go to standard error.", rich_help_panel=_PANEL),
]
NoProgress = Annotated[
    bool, typer.Option("--no-progress", help="Draw no progress bars.", rich_help_panel=_PANEL)
]
Cores = Annotated[
    int | None,
    typer.Option("-j", min=1, metavar="N", help="Use N cores; by default all.", rich_help_panel=_PANEL),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Say what would be done, and do nothing.", rich_help_panel=_PANEL)
]
Root = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Put outputs and the store under DIR; by default the working folder.",
        rich_help_panel=_PANEL,
    ),
]
Timeout = Annotated[
    float | None,
    typer.Option(
        min=0.01,
        metavar="MINUTES",
        help="End a job that shows no sign of life for so long, and try it again; by default "
        f"{PATIENCE / 60.0:g}.",
        rich_help_panel=_PANEL,
    ),
]
Nice = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=19,
        metavar="N",
        help="Let other programs go first, the more the higher N is: 10 is usual.",
        rich_help_panel=_PANEL,
    ),
]
ProfileName = Annotated[
    str | None,
    typer.Option(
        "--profile",
        metavar="NAME|DIR",
        envvar="FLOWSCULPT_PROFILE",
        help="Where jobs run: local, slurm, or another folder in profiles/ or at a path; see docs/farm.md.",
        rich_help_panel=_PANEL,
    ),
]


@dataclass
class _Said:
    """The common options as typed: what is not said stays empty."""

    json_: Json = False
    no_progress: NoProgress = False
    cores: Cores = None
    dry_run: DryRun = False
    root: Root = None
    timeout: Timeout = None
    nice: Nice = None
    profile: ProfileName = None

    def over(self, earlier: _Said) -> _Said:
        """What is said after the command wins over what is said before it."""
        return _Said(*(getattr(self, f.name) or getattr(earlier, f.name) for f in fields(self)))

    def common(self) -> Common:
        return Common(
            json=self.json_,
            progress=not (self.no_progress or self.json_),
            cores=self.cores or available_cores(),
            dry_run=self.dry_run,
            root=(self.root or Path()).resolve(),
            patience=PATIENCE if self.timeout is None else 60.0 * self.timeout,
            profile=Profile.named(self.profile) if self.profile else Profile.local(),
        )


def remember(
    ctx: typer.Context,
    json_: Json = False,
    no_progress: NoProgress = False,
    cores: Cores = None,
    dry_run: DryRun = False,
    root: Root = None,
    timeout: Timeout = None,
    nice: Nice = None,
    profile: ProfileName = None,
) -> None:
    """Keep what was said before the command's name."""
    ctx.obj = _Said(json_, no_progress, cores, dry_run, root, timeout, nice, profile)


def with_common(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command the common options; it is called with a `Common` first, then with its own parameters."""
    own = inspect.signature(function, eval_str=True).parameters
    shared = inspect.signature(remember, eval_str=True).parameters

    @functools.wraps(function)
    def command(ctx: typer.Context, **values: Any) -> None:
        said = _Said(**{f.name: values.pop(f.name) for f in fields(_Said)})
        said = said.over(ctx.obj or _Said())
        try:
            if said.nice:
                os.nice(said.nice)  # what this process starts is as nice
            function(said.common(), **values)
        except KeyboardInterrupt:
            complain("interrupted; what is done stays done, run again to go on")
            raise typer.Exit(INTERRUPTED) from None

    parameters = [shared["ctx"], *list(own.values())[1:], *[p for n, p in shared.items() if n != "ctx"]]
    keyword_only = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    command.__signature__ = inspect.Signature(keyword_only)  # type: ignore[attr-defined]  # typer reads it
    command.__annotations__ = {p.name: p.annotation for p in keyword_only}
    return command


Shots = Annotated[list[str], typer.Argument(metavar="SHOT…", help="Names in shots/, or paths of shot files.")]
OneShot = Annotated[str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")]
Frames = Annotated[
    str | None,
    typer.Option(
        "-f",
        "--frames",
        metavar="RANGE",
        help="Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Or in words, as status tells "
        "them: missing, stale, failed. By default all.",
    ),
]
Variant = Annotated[
    str | None,
    typer.Option(
        help=f"Render with this Mitsuba variant: {', '.join(VARIANTS)}; by default the first that works."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Put a value in place of the shot's, such as flows.0.vortex.strength=2; may be given again.",
    ),
]
AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Let shots run the Python files that they name as flows.")
]
Quality = Annotated[str, typer.Option("-q", "--quality", help=f"One of {', '.join(QUALITIES)}.")]

Crop = Annotated[
    str | None,
    typer.Option(
        metavar="X0,Y0,X1,Y1",
        help="Render a part: its left, upper, right and lower edge, in shares of the picture or in pixels.",
    ),
]
Scale = Annotated[
    str | None, typer.Option(metavar="PERCENT", help="Render smaller or larger pictures: 50%, or 0.5.")
]
