"""The command `sheet`: a contact sheet of a shot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import carried_out, tell_plan
from pipeline.cli.options import AllowCode, Common, Crop, Quality, Scale, Settings, Shot, Variant
from pipeline.cli.output import answer
from pipeline.cli.projects import project_of
from pipeline.errors import UsageError
from pipeline.production.planning.plan import Plan
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import find_shot


def sheet(
    common: Common,
    shot: Shot,
    frames: Annotated[
        str | None,
        typer.Option(
            "-f", "--frames", metavar="RANGE", help="By default up to twelve, evenly over the shot."
        ),
    ] = None,
    looks: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Instead: one frame in each of these looks, as in clay,glaze."),
    ] = None,
    at: Annotated[
        int | None, typer.Option("--at", metavar="FRAME", help="The frame of --looks; by default the middle.")
    ] = None,
    quality: Quality = "preview",
    columns: Annotated[int | None, typer.Option(min=1, help="Columns of the sheet.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the PNG there.")
    ] = None,
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Put frames of a shot on one contact sheet, rendering what is missing.

    `flowsculpt sheet A010_cube -f 1-58x3 --columns 5` is the shot over time; `flowsculpt sheet A010_cube
    --looks clay,glaze,chrome --at 44` is one frame in three looks, as wedge makes it.
    """
    if output is not None and output.suffix.lower() != ".png":
        raise UsageError(f"{output} is no PNG, which a sheet is; end its name in .png")
    if looks is not None:
        if output is not None or frames is not None:
            raise UsageError("--looks makes its sheet as wedge does; leave out -o and -f, and use --at")
        from pipeline.cli.commands.wedge import wedge

        if "," not in looks:
            raise UsageError(f"--looks {looks}: one look needs no sheet; name several, as in clay,glaze")
        varied = [f"look={looks}"]
        wedge(common, shot, varied, None, at, quality, columns, crop, scale, variant, settings, allow_code)
        return
    if at is not None:
        raise UsageError("--at is the frame of --looks; name the frames of a sheet with -f")
    from pipeline.dailies.sheets.sheet import Sheet, spread

    name = windowed(quality, crop, scale)
    project = project_of(common, settings, allow_code, variant)
    take = project.take(find_shot(shot), name, frames)
    made = Sheet(take if frames is not None else spread(take), project.store, columns)

    def planned() -> Plan:
        planner = project.planner_of(1)
        planner.pictures(made.take)
        return planner.plan()

    if common.dry_run:
        tell_plan(common, planned())
        return
    outcome = carried_out(common, planned)
    path = output or common.root / made.place
    made.write(path)
    many = len(made.take.requested)
    facts = {"path": str(path), "frames": list(made.take.requested), "rendered": outcome.made("render")}
    answer(f"{path}: {many} frame{'s' * (many > 1)}, {outcome.made('render')} rendered.", facts, common.json)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)
