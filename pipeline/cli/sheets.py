"""Commands that put a whole shot on one page: sheet, figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.arguments import AllowCode, Crop, Quality, Scale, Settings, Variant
from pipeline.cli.options import Common
from pipeline.cli.projects import project_of
from pipeline.cli.runs import carried_out, tell_plan
from pipeline.cli.say import answer
from pipeline.errors import MissingInputError, UsageError
from pipeline.production.planning.plan import Plan
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import find_shot

OneShot = Annotated[str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")]


def sheet(
    common: Common,
    shot: OneShot,
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
        from pipeline.cli.wedge import wedge

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


def figures(
    common: Common,
    shot: OneShot,
    quality: Quality = "draft",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="An SVG, PNG or PDF; by default renders/SHOT/SHOT.figures.svg.",
        ),
    ] = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Draw what was measured of a shot's meshes, frame by frame, and the seconds that its frames took.

    Vertices, splits and collapses, edge lengths, the roundness of triangles, area and volume: of the meshes
    that are simulated. The seconds of rendering are those of `--quality`.
    """
    from pipeline.dailies.sheets.figures import panels
    from pipeline.dailies.sheets.measures import limits_of, measured
    from pipeline.dailies.sheets.timing import Clocks, rendering
    from render.graphics.plot import plot_tracks

    project = project_of(common, settings, allow_code)
    take = project.take(find_shot(shot), quality, variant="none")
    numbers = sorted(take.poses)
    found = measured(take, project.store, numbers, common.cores)
    if not found:
        raise MissingInputError(
            f"{take.name} has no meshes yet, and figures are drawn from such; flowsculpt simulate {shot} "
            "makes them"
        )
    page = output or common.root / take.folders.home / f"{take.name}.figures.svg"
    seconds = Clocks(common.root).of(take.subject, take.name, quality)
    if rendered := rendering(take, common.root):
        seconds["render"] = {number: sum(parts.values()) for number, parts in rendered.items()}
    drawn = panels(numbers, found, limits_of(take), seconds)
    if not common.dry_run:
        plot_tracks(f"{take.name}: {take.shot.title}", drawn, float(take.shot.rate.fps), page)
    done = f"{page}: {len(drawn)} figures{', would be written' if common.dry_run else ''}."
    facts = {"path": str(page), "figures": [each.name for each in drawn], "frames": sorted(found)}
    answer(done, facts, common.json)
