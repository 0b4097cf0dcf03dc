"""Options that several commands take, each declared once."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.errors import UsageError, suggestion
from pipeline.production.request.lookup import today_name
from render.mitsuba.engine import VARIANTS
from render.scene.render_quality import CONVENTIONS, QUALITIES, qualities_of_size

if TYPE_CHECKING:  # imported when a command runs, for help and --version need neither
    from pipeline.production.execution.project import Project
    from pipeline.production.planning.profile import Profile


def shots_argument(help: str) -> Any:
    return typer.Argument(metavar="SHOT", help=help)


def frames_option(help: str) -> Any:
    return typer.Option("-f", "--frames", metavar="RANGE", help=help)


def at_option(help: str) -> Any:
    return typer.Option("--at", metavar="FRAME", help=help)


def output_option(help: str, metavar: str = "FILE") -> Any:
    return typer.Option("-o", "--output", metavar=metavar, help=help)


Shot = Annotated[str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")]
Subject = Annotated[
    str | None,
    typer.Option("--subject", metavar="NAME", help="One of the shot's subjects, if it has several."),
]
Shots = Annotated[list[str], shots_argument("Names in shots/, or paths of shot files.")]
Frames = Annotated[
    str | None,
    frames_option(
        "Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Or by state, as `status` lists them: "
        "missing, stale, failed. Default: all."
    ),
]


def _today_names(given: str | list[str] | None) -> str | list[str] | None:
    """Return the names of qualities as they are today."""
    return [today_name(name) for name in given] if isinstance(given, list) else given and today_name(given)


def quality_option(help: str = f"One of {', '.join(QUALITIES)}.", **settings: Any) -> Any:
    return typer.Option("-q", "--quality", metavar="QUALITY", help=help, callback=_today_names, **settings)


Quality = Annotated[str, quality_option()]
Variant = Annotated[
    str | None,
    typer.Option(
        metavar="VARIANT", help=f"Mitsuba variant: {', '.join(VARIANTS)}. Default: the first that works."
    ),
]
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
        metavar="PROGRAM",
        help="Write layers for compositing into finished frames, with the channel names of "
        f"{', '.join(CONVENTIONS)}; see docs/compositing.md. Default: what the shot says.",
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
        help="Draw no animatic. Default: in a terminal, one is drawn of what was not rendered yet at this "
        "quality; see docs/production.md.",
    ),
]
Plot = Annotated[Path | None, output_option("Write this SVG, PNG or PDF. Default: an SVG in renders/SHOT.")]
Crossings = Annotated[
    bool,
    typer.Option(
        "--crossings",
        help="Count pairs of faces that pass through each other in every frame. Default: in the first frame, "
        "every eighth after it and the last.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Replace a value of the shot, such as flows.0.vortex.strength=2. Repeatable.",
    ),
]
AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Let shots run the Python files that they name as flows.")
]


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


@dataclass(frozen=True)
class ShotOptions:
    """Options of commands that read shots."""

    settings: Settings = None
    allow_code: AllowCode = False

    def project(self, common: Common, variant: str | None = None) -> Project:
        """Return the project that a command works in."""
        return project_of(common, self.settings, self.allow_code, variant)


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
        return project_of(common, self.settings, self.allow_code, self.variant)

    def quality(self, name: str, project: Project, shots: Sequence[str]) -> str:
        """Return the name of a quality with crop and scale, as its folder has it.

        Raises UsageError for what cannot be cropped, among it shots and edits with pictures of several sizes.
        """
        from pipeline.production.request.lookup import cropped_name, is_quality

        if self.crop is None or not shots or not is_quality(name):
            return cropped_name(name, self.crop, self.scale)
        sizes = {request.source.summary.size for shot in shots for request in project.named(shot, name)}
        if len(sizes) > 1:
            raise UsageError(
                f"--crop {self.crop}: these have pictures of several sizes. Crop those of one size at a time."
            )
        return cropped_name(name, self.crop, self.scale, qualities_of_size(*sizes.pop()))


def project_of(
    common: Common, settings: Sequence[str] | None, allow_code: bool = False, variant: str | None = None
) -> Project:
    """Return the project at the root that the options name."""
    from pipeline.production.execution.project import Project

    return Project(common.root, common.cores, variant, tuple(settings or ()), allow_code, common.profile)


def require_one_of(word: str, known: Collection[str], fact: str) -> None:
    """Raise UsageError, with a fact and a suggestion, for a word that is not known."""
    if word not in known:
        raise UsageError(f"{fact} {suggestion(word, known)}")


def words_of(text: str, fault: str) -> tuple[str, ...]:
    """Return the words between commas, each once. Raises UsageError where there are none."""
    words = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    if not words:
        raise UsageError(fault)
    return words
