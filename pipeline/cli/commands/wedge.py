"""The commands `wedge` and `sheet`: variations of a shot, or its frames, on a contact sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import (
    count_words,
    execute,
    forecast_facts,
    forecast_words,
    made_by_stage,
    report_notes,
    report_plan,
)
from pipeline.cli.options import (
    Common,
    PictureOptions,
    Quality,
    Shot,
    at_option,
    frames_option,
    output_option,
)
from pipeline.cli.output import exit_with, print_result
from pipeline.errors import UsageError
from pipeline.production.planning.estimate import estimate
from pipeline.production.planning.forecast import Forecast
from pipeline.production.planning.plan import Plan
from pipeline.production.request.lookup import find_shot
from pipeline.production.stages import STAGES
from pipeline.production.versions.grid import MOST_CELLS, OPTION, Grid
from pipeline.production.versions.wedge import Wedge
from render.base.plural import plural
from render.scene.quality import DEFAULT_QUALITY


def wedge(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            OPTION,
            metavar="NAME=VALUES",
            help="Vary a value: NAME=first:last:count or NAME=value,value. Repeatable; cells are all "
            "combinations.",
        ),
    ] = None,
    frames: Annotated[str | None, frames_option("Frames of every cell. Default: the sheet's.")] = None,
    at: Annotated[int | None, at_option("The frame of the sheet. Default: the middle one.")] = None,
    quality: Quality = DEFAULT_QUALITY,
    columns: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Columns of the sheet. Default: the values of the last --vary."
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help=f"Allow more than {MOST_CELLS} cells.")] = False,
) -> None:
    """Render a shot in a grid of variations, and put them on a contact sheet.

    `flowsculpt wedge A010_cube --vary flows.0.twist.amount=20:80:4 --vary look=clay,glaze` renders the middle
    frame of eight cells to folders below renders/wedge/A010_cube, and a PNG labelled with their values. With
    `-f 1-48` it renders these frames of every cell, and the sheet is a movie too. Work that cells share is
    done once: a wedge over looks simulates the shot only once.
    """
    grid = Grid.parse(vary or [], yes)
    project, named = options.project(common), options.quality(quality)
    made = Wedge(project, find_shot(shot), grid, named, frames, at, columns)
    if common.dry_run:
        _report(common, made)
        return
    outcome = execute(common, made.plan)
    sheets = made.draw()
    facts = {
        "cells": _cells(made),
        "frame": made.number,
        "sheets": [path.as_posix() for path in sheets],
        "made": made_by_stage(outcome),
        "done": not outcome.unfinished,
    }
    rendered = f"{plural(len(grid), 'cell')}, {plural(outcome.made('render'), 'frame')} rendered"
    print_result(f"{', '.join(path.as_posix() for path in sheets)}: {rendered}.", facts, common.json)
    exit_with(outcome.exit_code)


def _report(common: Common, made: Wedge) -> None:
    """Report the grid and what a run would do for it."""
    plan = made.plan()
    forecast = Forecast.of(plan, made.project.store)
    expected = estimate(forecast.plan, common.root, common.cores)
    counts, spared = forecast.plan.frame_counts(), plan.spared
    report_notes(plan, set())
    todo = {stage: counts[stage] for stage in STAGES if counts[stage]}
    facts = {
        "cells": _cells(made),
        "frame": made.number,
        "to_be_made": todo,
        "shared": dict(spared),
        "estimate": expected.as_data(),
        **forecast_facts(forecast),
    }
    lines = [f"{'  '.join(cell.settings)}" for cell, _ in made.requests]
    frames = len(made.requests[0][1].requested)
    lines.append(f"{plural(len(lines), 'cell')} of {plural(frames, 'frame')}, the sheet at {made.number}.")
    lines.append(forecast_words(forecast, expected) if todo else "Nothing to be done but the sheet.")
    if spared:
        lines.append(f"Shared by cells, and done once: {count_words(spared)}.")
    print_result("\n".join(lines), facts, common.json)


def _cells(made: Wedge) -> list[dict[str, object]]:
    return [{"settings": list(cell.settings), "folder": request.home} for cell, request in made.requests]


def sheet(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    frames: Annotated[str | None, frames_option("Default: up to twelve, evenly over the shot.")] = None,
    looks: Annotated[
        str | None, typer.Option(metavar="NAMES", help="One frame in each of these looks, as in clay,glaze.")
    ] = None,
    at: Annotated[int | None, at_option("The frame of --looks. Default: the middle one.")] = None,
    quality: Quality = DEFAULT_QUALITY,
    columns: Annotated[int | None, typer.Option(min=1, metavar="N", help="Columns of the sheet.")] = None,
    output: Annotated[Path | None, output_option("Write this PNG.")] = None,
) -> None:
    """Put frames of a shot on one contact sheet, rendering what is missing.

    `flowsculpt sheet A010_cube -f 1-58x3 --columns 5` shows the shot over time. `flowsculpt sheet A010_cube
    --looks clay,glaze,chrome --at 44` shows one frame in three looks; it is a wedge.
    """
    if output is not None and output.suffix.lower() != ".png":
        raise UsageError(f"{output} is no PNG, which a sheet is; end its name in .png")
    if looks is not None:
        if output is not None or frames is not None:
            raise UsageError(
                "--looks draws the sheet of a wedge; leave out -o and -f, and choose the frame by --at"
            )
        if "," not in looks:
            raise UsageError(f"--looks {looks}: one look needs no sheet; name several, as in clay,glaze")
        wedge(common, shot, options, [f"look={looks}"], None, at, quality, columns)
        return
    if at is not None:
        raise UsageError("--at is the frame of --looks; name the frames of a sheet with -f")
    from pipeline.dailies.sheets import ShotSheet, spread

    project, name = options.project(common), options.quality(quality)
    request = project.request(find_shot(shot), name, frames)
    made = ShotSheet(request if frames is not None else spread(request), project.store, columns)

    def planned() -> Plan:
        return project.frames([made.request])

    if common.dry_run:
        report_plan(common, planned())
        return
    outcome = execute(common, planned)
    path = output or common.root / made.place
    made.write(path)
    many = len(made.request.requested)
    facts = {"path": str(path), "frames": list(made.request.requested), "rendered": outcome.made("render")}
    print_result(f"{path}: {plural(many, 'frame')}, {outcome.made('render')} rendered.", facts, common.json)
    exit_with(outcome.exit_code)
