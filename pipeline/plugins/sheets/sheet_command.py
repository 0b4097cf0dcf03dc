"""The command `sheet`: a contact sheet of a shot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import execute, report_plan
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
from pipeline.production.planning.plan import Plan
from pipeline.production.request.lookup import find_shot
from render.base.plural import plural
from render.scene.render_quality import DEFAULT_QUALITY


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
    """Draw a contact sheet of a shot's frames, rendering what is missing.

    `flowsculpt sheet A010_cube -f 1-58x3 --columns 5` shows the shot over time. `flowsculpt sheet A010_cube
    --looks clay,glaze,chrome --at 44` shows one frame in three looks; it is a wedge.
    """
    if output is not None and output.suffix.lower() != ".png":
        raise UsageError(f"{output} is not a PNG; a sheet's name ends in .png")
    if looks is not None:
        if output is not None or frames is not None:
            raise UsageError(
                "--looks draws the sheet of a wedge; leave out -o and -f, and choose the frame by --at"
            )
        from pipeline.plugins.sheets.wedge_command import wedge

        if "," not in looks:
            raise UsageError(f"--looks {looks}: one look needs no sheet; name several, as in clay,glaze")
        wedge(common, shot, options, [f"look={looks}"], None, at, quality, columns)
        return
    if at is not None:
        raise UsageError("--at is the frame of --looks; name the frames of a sheet with -f")
    from pipeline.plugins.sheets.shot_sheet import ShotSheet, spread

    project = options.project(common)
    request = project.request(find_shot(shot), options.quality(quality, project, [shot]), frames)
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
