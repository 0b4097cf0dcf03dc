"""Commands that make files: simulate, render, stills, film, turntable."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.progress import STAGES, Bars
from pipeline.cli.say import answer, complain, err, warn
from pipeline.production.folder import FILM, find_edit
from pipeline.production.plan import Plan
from pipeline.production.run import Outcome, run
from pipeline.production.take import FORMS
from pipeline.production.window import windowed
from pipeline.production.workflow import Studio
from render.engine import VARIANTS
from render.quality import QUALITIES

Shots = Annotated[list[str], typer.Argument(metavar="SHOT…", help="Names in shots/, or paths of shot files.")]
Frames = Annotated[
    str | None,
    typer.Option(
        "-f", "--frames", metavar="RANGE", help="Frames: 12, 1-48, 1-48x2, 1-24,30; by default all."
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


def simulate(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Simulate shots: move and resample their surfaces, frame by frame.

    Mesh frames appear in renders/SHOT/meshes. After an edit a simulation goes on from the last frame that
    the edit left valid. Vertices are numbered for life in them, and new ones name their parents; those of
    method polyhedra are not.
    """
    studio = Studio(common.root, common.cores, settings=tuple(settings or ()), allow_code=allow_code)
    _make(common, lambda: studio.meshes(shots, frames))


def render(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    quality: Quality = "draft",
    variant: Variant = None,
    crop: Crop = None,
    scale: Scale = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Render shots, or a range of their frames, and assemble the movie.

    Only what is missing or stale is made: `flowsculpt render A010_cube -f 10-20x2 -q preview` renders six
    frames, and nothing when called again. Parts and scaled pictures have folders of their own, such as
    preview.scale50; a part shows what the whole picture does there, with other noise.
    """
    quality = windowed(quality, crop, scale)
    studio = Studio(common.root, common.cores, variant, tuple(settings or ()), allow_code)
    _make(common, lambda: studio.pictures(shots, quality, frames))


def stills(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    quality: Quality = "final",
    form: Annotated[
        str,
        typer.Option("--as", help=f"One of {', '.join(FORMS)}: 8 bits, 16 bits, or 8 bits compressed."),
    ] = "png",
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Write frames of shots as pictures that any program shows, rendering what is missing.

    They are seen through the shot's view and exposure and lie in renders/SHOT/QUALITY/FORM.
    `flowsculpt stills A010_cube -f 40` is a final still. The frames themselves, linear EXR with all layers,
    are in renders/SHOT/QUALITY/frames and raw.
    """
    quality = windowed(quality, crop, scale)
    studio = Studio(common.root, common.cores, variant, tuple(settings or ()), allow_code)
    _make(common, lambda: studio.stills(shots, form, quality, frames))


def film(
    common: Common,
    edit: Annotated[
        str, typer.Argument(help="An edit: its name in shots/, or the path of its file.")
    ] = FILM.stem,
    quality: Quality = "draft",
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Render every shot of an edit and cut them into renders/film/QUALITY/EDIT.mp4.

    Without a name it is shots/film.yaml; `flowsculpt film showreel` is shots/showreel.yaml. What is `--set`
    is set in every shot.
    """
    studio = Studio(common.root, common.cores, variant, tuple(settings or ()), allow_code)
    _make(common, lambda: studio.film(quality, find_edit(edit)))


def turntable(
    common: Common,
    subject: Annotated[
        str, typer.Argument(metavar="SHOT|MESHFILE", help="A shot, or an OBJ, PLY, STL, OFF or GLB.")
    ],
    at: Annotated[
        int | None, typer.Option(metavar="FRAME", help="The shot's frame; by default its first.")
    ] = None,
    frames: Annotated[int, typer.Option(help="How many pictures a full turn has.")] = 72,
    look: Annotated[str | None, typer.Option(help="The look of a mesh file; shots have their own.")] = None,
    quality: Quality = "preview",
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Turn one frame of a shot, or a mesh file, through 360° before the camera."""
    _make(
        common,
        lambda: Studio(common.root, common.cores, variant, tuple(settings or ()), allow_code).turntable(
            subject, quality, at, frames, look
        ),
    )


def _make(common: Common, make_plan: Callable[[], Plan]) -> None:
    """Plan, run, and say what became of it."""
    if common.dry_run:
        tell_plan(common, make_plan())
        return
    started = time.monotonic()
    outcome = carried_out(common, make_plan)
    seconds = time.monotonic() - started
    answer(_achieved(outcome, seconds), _outcome_facts(outcome, seconds), common.json)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def tell_plan(common: Common, plan: Plan) -> None:
    _tell_notes(plan, set())
    answer(_intended(plan), _plan_facts(plan), common.json)


def carried_out(common: Common, make_plan: Callable[[], Plan]) -> Outcome:
    """Plan and run, with bars, and tell what failed."""
    watch = (
        (lambda plan, reader: Bars(plan, reader, err))
        if common.progress
        else lambda plan, reader: nullcontext()
    )
    told: set[str] = set()

    def planned() -> Plan:
        plan = make_plan()
        _tell_notes(plan, told)
        return plan

    outcome = run(planned, common.root, common.cores, watch)
    for message in outcome.warnings:
        warn(message)
    for failure in outcome.failures:
        complain(_failure(failure))
    return outcome


def _tell_notes(plan: Plan, told: set[str]) -> None:
    """Those not told yet."""
    for note in plan.notes:
        if note not in told:
            warn(note)
            told.add(note)


def _intended(plan: Plan) -> str:
    if not plan.jobs:
        return "Nothing to be done."
    counts: Counter[str] = Counter()
    for job in plan.jobs:
        counts[job.task] += len(job.frames)
    stages = ", ".join(f"{STAGES[task]} {counts[task]} frames" for task in STAGES if counts[task])
    return f"To be done: {stages}."


def _achieved(outcome: Outcome, seconds: float) -> str:
    films = [target for target in outcome.plan.targets if target.endswith(".mp4")]
    films = films or _folders(outcome.plan.targets)
    if outcome.unfinished:
        return f"Not finished after {seconds:.0f} s; what is done stays done."
    shown = ", ".join(films) or f"{len(outcome.plan.targets)} files"
    if not outcome.events:
        again = f" ({outcome.restored} links restored)" if outcome.restored else ""
        return f"Nothing to be done{again}: {shown}"
    return f"Done in {seconds:.0f} s ({outcome.made('render')} frames rendered): {shown}"


def _folders(targets: Sequence[str]) -> list[str]:
    """Where stills lie, where they are what was asked for."""
    stills = [Path(target) for target in targets if Path(target).parent.name in FORMS]
    if len(stills) == 1:
        return [stills[0].as_posix()]
    return list(dict.fromkeys(f"{still.parent.as_posix()}/" for still in stills))


def _failure(event: dict[str, Any]) -> str:
    frame = event.get("frame")
    message = str(event["message"]).removeprefix(f"frame {frame}: ")
    return f"{event['shot']} frame {frame}: {message}" if frame is not None else f"{event['shot']}: {message}"


def _plan_facts(plan: Plan) -> dict[str, Any]:
    jobs = [{"job": job.name, "task": job.task, "frames": list(job.frames)} for job in plan.jobs]
    return {"jobs": jobs, "targets": list(plan.targets)}


def _outcome_facts(outcome: Outcome, seconds: float) -> dict[str, Any]:
    return {
        "done": not outcome.unfinished,
        "seconds": round(seconds, 2),
        "made": {stage: outcome.made(stage) for stage in STAGES if outcome.made(stage)},
        "links_restored": outcome.restored,
        "warnings": [*outcome.plan.notes, *outcome.warnings],
        "failed": [
            {name: failure.get(name) for name in ("shot", "stage", "frame", "message")}
            for failure in outcome.failures
        ],
        "targets": list(outcome.plan.targets),
    }
