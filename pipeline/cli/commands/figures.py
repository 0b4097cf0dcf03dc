"""The commands `figures` and `curves`: plots of a shot over its frames."""

from __future__ import annotations

from pipeline.cli.options import Common, Crossings, Plot, Quality, Settings, Shot, ShotOptions
from pipeline.cli.output import make_folder_of, print_result
from pipeline.dailies.measures import TIMED_STAGES, limits_of, measured
from pipeline.dailies.sheets import panels
from pipeline.errors import MissingInputError, UsageError
from pipeline.production.planning.timings import LatestTimings, render_seconds
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.paths import Folders
from pipeline.production.store.store import Store
from pipeline.shot import read_shot
from pipeline.shot.keyed_curves import curves_of
from render.graphics.plot import Curves, plot_panels
from render.scene.quality import DEFAULT_QUALITY


def figures(
    common: Common,
    shot: Shot,
    options: ShotOptions,
    quality: Quality = DEFAULT_QUALITY,
    output: Plot = None,
    crossings: Crossings = False,
) -> None:
    """Plot the measures of a shot's meshes, and the seconds of its frames, over its frames.

    `flowsculpt figures A010_cube` writes renders/A010_cube/A010_cube.figures.svg: vertices, splits and
    collapses, edge lengths, roundness of triangles, area and volume of all mesh frames simulated so far, and
    crossings where there are any. The seconds of rendering are those of `--quality`.
    """
    project = options.project(common)
    request = project.request(find_shot(shot), quality, variant="none")
    numbers = sorted(request.angles)
    measures = measured(request, project.store, numbers, common.cores, count_crossings=crossings)
    if not measures:
        raise MissingInputError(
            f"{request.name} has no meshes yet, and figures are drawn from such; flowsculpt simulate {shot} "
            "makes them"
        )
    page = output or common.root / request.folders.home / f"{request.name}.figures.svg"
    latest = LatestTimings(common.root)
    seconds = latest.by_stage(request.subject, request.name, quality, TIMED_STAGES)
    if rendered := render_seconds(request, common.root):
        seconds["render"] = {number: sum(parts.values()) for number, parts in rendered.items()}
    drawn = panels(numbers, measures, limits_of(request), seconds)
    if not common.dry_run:
        title, rate = request.shot.heading, float(request.shot.rate.fps)
        project.store.write(page, lambda path: plot_panels(title, drawn, rate, path))
    words = f"{page}: {len(drawn)} figures{', would be written' if common.dry_run else ''}."
    facts = {"path": str(page), "figures": [panel.name for panel in drawn], "frames": sorted(measures)}
    print_result(words, facts, common.json)


def curves(common: Common, shot: Shot, output: Plot = None, settings: Settings = None) -> None:
    """Draw everything in a shot that changes over time: values over frames, with their keys as dots.

    `flowsculpt curves A010_cube` writes renders/A010_cube/A010_cube.curves.svg.
    """
    path = find_shot(shot)
    keyed = curves_of(path, settings or ())
    if not keyed:
        raise UsageError(
            f"{path} has nothing that changes over time; give a number keys, as {{keys: {{1: 0, 24: 2}}}}"
        )
    clock = read_shot(path, settings=settings or ()).motion.clock
    page = output or common.root / Folders.of_shot(path.stem).home / f"{path.stem}.curves.svg"
    if not common.dry_run:
        make_folder_of(page)
        tracks = [Curves(c.name, c.unit, c.frames, c.values, c.keys) for c in keyed]
        store, rate = Store(common.root), float(clock.rate.fps)
        store.write(page, lambda draft: plot_panels(path.stem, tracks, rate, draft))
    words = f"{page}: {len(keyed)} curves{', would be written' if common.dry_run else ''}."
    print_result(words, {"path": str(page), "curves": [curve.name for curve in keyed]}, common.json)
