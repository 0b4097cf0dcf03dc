"""Options of commands, each declared once, and how a function that takes options becomes a command."""

from __future__ import annotations

import copy
import functools
import inspect
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer
from typer.models import OptionInfo

from flowsculpt.pipeline.cli.output import print_error, print_warning, tell_of_store
from flowsculpt.pipeline.errors import MachineError, UsageError, suggest
from flowsculpt.pipeline.frames import FrameRange, FrameSelection
from flowsculpt.pipeline.plugin import Command, plugins
from flowsculpt.pipeline.production.request.lookup import today_name
from flowsculpt.pipeline.production.store.paths import require_store
from flowsculpt.pipeline.production.store.remote_store import READ_ONLY, VARIABLE, use_store
from flowsculpt.render.mitsuba.engine import VARIANTS, available_cores
from flowsculpt.render.scene.render_quality import CONVENTIONS, QUALITIES, qualities_of_size

if TYPE_CHECKING:  # imported when a command runs, for help and --version need neither
    from flowsculpt.pipeline.production.execution.project import Project
    from flowsculpt.pipeline.production.planning.profile import Profile


def require_readable(*words: str) -> None:
    """Raise UsageError for words that are not UTF-8, and as `require_readable_path` for files."""
    for word in words:
        name = word.encode(errors="surrogateescape").decode(errors="backslashreplace")
        if name != word:
            raise UsageError(f"{name}: this name is not UTF-8, as on some old file shares; rename it")
        if os.path.lexists(word):
            require_readable_path(word)


def require_readable_path(path: str) -> None:
    """Raise UsageError for a path that messages, logs and shot files cannot hold in one line."""
    if re.search(r"[\x00-\x1f\x7f]", path):
        raise UsageError(f"{path!r}: a line break or control character in a path; rename it")


_OPTIONS = {
    "--frames": "--frame --range --start --end",
    "-f": "-r -s -e",
    "-j": "--cores --threads --jobs -c",
    "--dry-run": "-n --dryrun",
    "--force": "--overwrite -F",
    "--scale 50%": "--resolution --res --size",
    "--set quality.draft.samples=16": "--samples --spp",
    "--as": "--format",
    "-o": "--out",
    "--variant cuda_ad_rgb": "--device --gpu",
    "--root": "--directory -d",
}
"""By options, those of other programs that do the same."""


def require_command(name: str, commands: Mapping[str, Command]) -> None:
    """Raise UsageError for a command that has another name here, or whose plug-in is missing."""
    others = {each: command.also for each, command in commands.items()} | {"--help": "help"}
    meant = _meant(others, name.lower())
    remedy = f"Did you mean {meant}?" if meant else plugins().lacking(f"flowsculpt {name}")
    if name not in commands and remedy:
        raise UsageError(f"unknown command {name}. {remedy}")


def _meant(table: Mapping[str, str], word: str) -> str | None:
    return next((name for name, words in table.items() if word in words.split()), None)


def require_options(words: Iterable[str], known: Collection[str]) -> None:
    """Raise UsageError for an option that has another name here.

    known  the options of the command
    """
    for word in words:
        name = word.partition("=")[0]
        meant = _meant(_OPTIONS, name)
        if name not in known and meant and meant.split()[0] in known:
            raise UsageError(f"unknown option {name}. Did you mean {meant}?")


def _today_names(given: str | list[str] | None) -> str | list[str] | None:
    """Return the names of qualities as they are today."""
    return [today_name(name) for name in given] if isinstance(given, list) else given and today_name(given)


def shared_option(name: str, help: str = "", **settings: Any) -> Any:
    """Return an option that several commands have, with a help of its own where one is given.

        output: Annotated[Path | None, shared_option("output", "Write this file.")] = None

    name      `allow_code`; `at`, a frame; `frames`, a FrameRange; `output`, a file; `quality`; `settings` of
              the shot; or `variant`, the renderer
    settings  of `typer.Option`, in place of the usual ones
    """
    words, usual = _SHARED[name]
    return typer.Option(*words, **{**usual, **({"help": help} if help else {}), **settings})


_SHARED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "allow_code": (("--allow-code",), {"help": "Let shots run the Python files that they name as flows."}),
    "at": (("--at",), {"metavar": "FRAME"}),
    "frames": (("-f", "--frames"), {"metavar": "RANGE", "parser": FrameRange.parse}),
    "output": (("-o", "--output"), {"metavar": "FILE"}),
    "quality": (("-q", "--quality"), {"metavar": "QUALITY", "callback": _today_names}),
    "settings": (
        ("--set",),
        {
            "metavar": "NAME=VALUE",
            "help": "Replace a value of the shot, such as flows.0.vortex.strength=2. Repeatable.",
        },
    ),
    "variant": (
        ("--variant",),
        {"metavar": "|".join(VARIANTS), "help": "Mitsuba variant. Default: the first that works."},
    ),
}
"""Words and settings of options by name."""

Shot = Annotated[str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")]
"""The parameter of a command that takes one shot."""

Shots = Annotated[list[str], typer.Argument(metavar="SHOT", help="Names in shots/, or paths of shot files.")]
Frames = Annotated[
    FrameSelection | None,
    shared_option(
        "frames",
        "Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Or by state, as `status` lists them: "
        "missing, stale, failed. Default: all.",
        parser=FrameSelection.of_text,
    ),
]
"""The option `-f`: a FrameRange, words for the states of frames, or None for all."""

Quality = Annotated[str, shared_option("quality", f"One of {', '.join(QUALITIES)}.")]
"""The option `-q`; its default is DEFAULT_QUALITY."""

Variant = Annotated[str | None, shared_option("variant")]
Scale = Annotated[
    str | None, typer.Option(metavar="PERCENT", help="Render smaller or larger pictures: 50%, or 0.5.")
]
Crop = Annotated[
    str | None,
    typer.Option(
        metavar="X0,Y0,X1,Y1",
        help="Render a part: its left, upper, right and lower edge, in fractions of the picture or pixels.",
    ),
]
Layers = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(CONVENTIONS),
        help="Write layers for compositing into finished frames, with the channel names of a program; see "
        "docs/compositing.md. Default: what the shot says.",
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Render and finish the frames again and replace what is stored. Meshes and cameras are reused: "
        "`snakemake --forcerun simulate` makes these again too.",
    ),
]
NoPreview = Annotated[
    bool,
    typer.Option(
        "--no-preview",
        help="Draw no animatic. Default: in a terminal, one is drawn of the frames not rendered yet at this "
        "quality; see docs/production.md.",
    ),
]
Settings = Annotated[list[str] | None, shared_option("settings")]
AllowCode = Annotated[bool, shared_option("allow_code")]


@dataclass(frozen=True)
class Common:
    """The common options, resolved. The first parameter of every command.

    patience  seconds without a sign of life after which a job is ended; None is the default
    """

    json: bool
    progress: bool
    cores: int
    dry_run: bool
    root: Path
    patience: float | None
    profile: Profile
    wait: bool = False

    def done(self, verb: str) -> str:
        """Return what became of an output: `written`, or `would be written` with --dry-run."""
        return f"would be {verb}" if self.dry_run else verb

    def with_own_root(self, root: Path) -> Common:
        """Return the options of a run in another root; from now on this process shares no remote store.

        What a remote store has would prove nothing about frames that are made again.
        """
        use_store(None)
        return replace(self, root=root)


@dataclass(frozen=True)
class ShotOptions:
    """Options of commands that read shots."""

    settings: Settings = None
    allow_code: AllowCode = False

    def project(self, common: Common, variant: str | None = None) -> Project:
        """Return the project that a command works in."""
        from flowsculpt.pipeline.production.execution.project import Project

        settings = tuple(self.settings or ())
        return Project(common.root, common.cores, variant, settings, self.allow_code, common.profile)


@dataclass(frozen=True)
class PictureOptions:
    """Options of commands that read and render shots."""

    crop: Crop = None
    scale: Scale = None
    variant: Variant = None
    settings: Settings = None
    allow_code: AllowCode = False

    def project(self, common: Common) -> Project:
        """Return the project that a command works in."""
        return ShotOptions(self.settings, self.allow_code).project(common, self.variant)

    def quality(self, name: str, project: Project, shots: Sequence[str]) -> str:
        """Return the name of a quality with crop and scale, as its folder has it.

        Raises UsageError for what cannot be cropped, among it shots and edits with pictures of several sizes.
        """
        from flowsculpt.pipeline.production.request.lookup import QualityName, cropped_name

        if self.crop is None or not shots or not QualityName.of(name).is_known:
            return cropped_name(name, self.crop, self.scale)
        sizes = {request.manifest.size for shot in shots for request in project.find_requests(shot, name)}
        if len(sizes) > 1:
            raise UsageError(
                f"--crop {self.crop}: these have pictures of several sizes. Crop those of one size at a time."
            )
        return cropped_name(name, self.crop, self.scale, qualities_of_size(*sizes.pop()))


def require_one_of(word: str, known: Collection[str], fact: str, within: str = "") -> None:
    """Raise UsageError for an unknown word: a fact, and a suggestion or the plug-in that it needs.

    within  what stands before the word where plug-ins add it: "flowsculpt export "
    """
    if word not in known:
        raise UsageError(f"{fact} {plugins().lacking(within + word) or suggest(word, known)}")


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
    store_read_only: Annotated[
        bool,
        _common(
            "--store-read-only", envvar=READ_ONLY, help="Take what the store has, and write nothing to it."
        ),
    ] = False
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
        from flowsculpt.pipeline.production.planning.profile import Profile

        given = CommonOptions(*(getattr(self, f.name) or getattr(before, f.name) for f in fields(self)))
        if given.nice and hasattr(os, "nice"):  # Windows has other priorities
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
            use_store(given.store)  # so do they
            tell_of_store(progress)
        if given.store_read_only:
            os.environ[READ_ONLY] = "1"
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
    """Make a function a command: its parameter `common`, if any, stands for the common options, and a
    parameter whose type is a dataclass for the options that are its fields.

    Raises MachineError for an option that is not in an `Annotated`.
    """
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
        if "common" in own:
            values["common"] = given.resolved(ctx.obj or CommonOptions())
        try:
            function(**values)
        except KeyboardInterrupt:
            print_error("interrupted; what is done stays done, run again to go on")
            raise typer.Exit(INTERRUPTED) from None

    inner = [p for options in groups.values() for p in parameters_of(options)]
    for p in (*plain, *inner):
        given = p.default.default if isinstance(p.default, OptionInfo) else None
        if isinstance(p.annotation, OptionInfo) or str(given).startswith("-"):  # its words taken as a default
            raise MachineError(
                f"{function.__module__}:{function.__name__}: its parameter {p.name} is an option without a "
                f"type; write {p.name}: Annotated[TYPE, OPTION] = DEFAULT"
            )
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
