"""The command `figures`: curves of what was measured of a shot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import AllowCode, Common, Quality, Settings, Shot
from pipeline.cli.output import answer
from pipeline.cli.projects import project_of
from pipeline.errors import MissingInputError
from pipeline.production.request.lookup import find_shot


def figures(
    common: Common,
    shot: Shot,
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
    request = project.request(find_shot(shot), quality, variant="none")
    numbers = sorted(request.angles)
    found = measured(request, project.store, numbers, common.cores)
    if not found:
        raise MissingInputError(
            f"{request.name} has no meshes yet, and figures are drawn from such; flowsculpt simulate {shot} "
            "makes them"
        )
    page = output or common.root / request.folders.home / f"{request.name}.figures.svg"
    seconds = Clocks(common.root).of(request.subject, request.name, quality)
    if rendered := rendering(request, common.root):
        seconds["render"] = {number: sum(parts.values()) for number, parts in rendered.items()}
    drawn = panels(numbers, found, limits_of(request), seconds)
    if not common.dry_run:
        plot_tracks(f"{request.name}: {request.shot.title}", drawn, float(request.shot.rate.fps), page)
    done = f"{page}: {len(drawn)} figures{', would be written' if common.dry_run else ''}."
    facts = {"path": str(page), "figures": [each.name for each in drawn], "frames": sorted(found)}
    answer(done, facts, common.json)
