"""The command wedge: a shot in many variations, on one contact sheet."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import carried_out, expected_words
from pipeline.cli.options import AllowCode, Common, Crop, Quality, Scale, Settings, Variant
from pipeline.cli.output import answer, warn
from pipeline.cli.projects import project_of
from pipeline.production.keys.stages import STAGES
from pipeline.production.planning.estimate import estimate
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import find_shot
from pipeline.production.versions.grid import MOST_CELLS, OPTION, Grid
from pipeline.production.versions.wedge import Wedge, frames_by_task


def wedge(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            OPTION,
            metavar="NAME=VALUES",
            help="What changes: NAME=first:last:count or NAME=value,value; given again, every combination.",
        ),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(
            "-f",
            "--frames",
            metavar="RANGE",
            help="Frames of every cell; by default that of the sheet alone.",
        ),
    ] = None,
    at: Annotated[
        int | None,
        typer.Option("--at", metavar="FRAME", help="The frame of the sheet; by default the middle one."),
    ] = None,
    quality: Quality = "preview",
    columns: Annotated[
        int | None,
        typer.Option(min=1, help="Columns of the sheet; by default as the last --vary says."),
    ] = None,
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
    yes: Annotated[bool, typer.Option("--yes", help=f"Allow more than {MOST_CELLS} cells.")] = False,
) -> None:
    """Render a shot in a grid of variations, and a contact sheet of them.

    `flowsculpt wedge A010_cube --vary flows.0.twist.amount=20:80:4 --vary look=clay,glaze` renders the
    middle frame of eight cells, each in its folder below renders/wedge/A010_cube, and a PNG with their values
    as labels. With `-f 1-48` all these frames are rendered, and the sheet is a movie too. What cells have in
    common is made once: a wedge over looks simulates nothing again.
    """
    grid = Grid.parse(vary or [], yes)
    project = project_of(common, settings, allow_code, variant)
    made = Wedge(project, find_shot(shot), grid, windowed(quality, crop, scale), frames, at, columns)
    if common.dry_run:
        _tell(common, made)
        return
    outcome = carried_out(common, made.plan)
    sheets = made.draw()
    facts = {
        "cells": _cells(made),
        "frame": made.number,
        "sheets": [path.as_posix() for path in sheets],
        "made": {stage: outcome.made(stage) for stage in STAGES if outcome.made(stage)},
        "done": not outcome.unfinished,
    }
    rendered = f"{len(grid)} cells, {outcome.made('render')} frames rendered"
    answer(f"{', '.join(path.as_posix() for path in sheets)}: {rendered}.", facts, common.json)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def _tell(common: Common, made: Wedge) -> None:
    """The grid, and what is to be done for it."""
    apart, plan = made.plans()
    expected = estimate(plan, common.root, common.cores)
    counts, spared = frames_by_task(plan), frames_by_task(apart) - frames_by_task(plan)
    for note in plan.notes:
        warn(note)
    todo = {stage: counts[stage] for stage in STAGES if counts[stage]}
    facts = {
        "cells": _cells(made),
        "frame": made.number,
        "to_be_made": todo,
        "shared": dict(spared),
        "estimate": expected.as_data(),
        "jobs": [{"job": job.name, "task": job.task, "frames": list(job.frames)} for job in plan.jobs],
    }
    lines = [f"{'  '.join(cell.settings)}" for cell, _ in made.takes]
    frames = len(made.takes[0][1].requested)
    lines.append(
        f"{len(lines)} cells of {frames} frame{'s' if frames > 1 else ''}, the sheet at {made.number}."
    )
    told = ", ".join(f"{STAGES[stage].doing} {many} frames" for stage, many in todo.items())
    lines.append(f"To be done: {told}." if todo else "Nothing to be done but the sheet.")
    if spared:
        told = ", ".join(
            f"{STAGES[stage].doing} {spared[stage]} frames" for stage in STAGES if stage in spared
        )
        lines.append(f"Shared, and so not done again: {told}.")
    if plan.jobs:
        lines.append(expected_words(expected))
    answer("\n".join(lines), facts, common.json)


def _cells(made: Wedge) -> list[dict[str, object]]:
    return [{"settings": list(cell.settings), "folder": take.home} for cell, take in made.takes]
