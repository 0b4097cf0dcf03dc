"""The commands `figures` and `curves`: plots of a shot over its frames."""

from __future__ import annotations

from pathlib import Path

from pipeline.cli.options import Common, Crossings, Plot, Quality, Settings, Shot, ShotOptions, Subject
from pipeline.cli.output import make_folder_of, print_result
from pipeline.errors import MissingInputError, UsageError
from pipeline.plugins.sheets.shot_sheet import panels
from pipeline.production.execution.project import Project
from pipeline.production.measures import TIMED_STAGES, limits_of, measured
from pipeline.production.planning.timings import LatestTimings, render_seconds
from pipeline.production.request.lookup import find_shot
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.paths import Folders
from pipeline.production.store.store import Store
from pipeline.shot import read_shot
from pipeline.shot.settable_values import curves_of
from render.graphics.plot import Curves, plot_panels
from render.scene.render_quality import DEFAULT_QUALITY


def figures(
    common: Common,
    shot: Shot,
    options: ShotOptions,
    quality: Quality = DEFAULT_QUALITY,
    output: Plot = None,
    crossings: Crossings = False,
    subject: Subject = None,
) -> None:
    """Plot the measures and times of a shot's meshes over its frames.

    `flowsculpt figures A010_cube` writes renders/A010_cube/A010_cube.figures.svg: vertices, splits and
    collapses, edge lengths, roundness of triangles, area and volume of all mesh frames simulated so far, and
    crossings where there are any. The seconds of rendering are those of `--quality`. Several subjects have a
    page each.
    """
    project = options.project(common)
    whole = project.request(find_shot(shot), quality, variant="none").of_subject(subject)
    if output is not None and len(whole.parts) > 1:
        raise UsageError(f"-o {output} is one file, but {whole.name} has several subjects; choose --subject")
    drawn = [_drawn(common, project, request, output, crossings) for request in whole.parts]
    if not any(measured for _, _, measured in drawn):
        raise MissingInputError(
            f"{whole.name} has no meshes to draw figures from; flowsculpt simulate {shot} makes them"
        )
    told = [(page, names, frames) for page, names, frames in drawn if frames]
    done = ", would be written" if common.dry_run else ""
    words = "\n".join(f"{page}: {len(names)} figures{done}." for page, names, _ in told)
    facts = [{"path": str(page), "figures": names, "frames": frames} for page, names, frames in told]
    print_result(words, facts[0] if len(whole.parts) == 1 else facts, common.json)


def _drawn(
    common: Common, project: Project, request: RenderRequest, output: Path | None, crossings: bool
) -> tuple[Path, list[str], list[int]]:
    """Draw the figures of a shot with one subject, or of one of several.

    Return the path, the names of the figures and the frames that were measured; no page without frames.
    """
    numbers, name = sorted(request.angles), request.motion_folders.part_name
    page = output or common.root / request.folders.home / f"{name}.figures.svg"
    measures = measured(request, project.store, numbers, common.cores, count_crossings=crossings)
    if not measures:
        return page, [], []
    latest = LatestTimings(common.root)
    seconds = latest.by_stage(request.subject, request.name, request.quality_name, TIMED_STAGES)
    if rendered := render_seconds(request, common.root):
        seconds["render"] = {number: sum(parts.values()) for number, parts in rendered.items()}
    drawn = panels(numbers, measures, limits_of(request), seconds)
    if not common.dry_run:
        heading, rate = request.shot.heading, float(request.shot.rate.fps)
        title = f"{heading}: {request.source.subject}" if request.source.subject else heading
        project.store.write(page, lambda path: plot_panels(title, drawn, rate, path))
    return page, [panel.name for panel in drawn], sorted(measures)


def curves(common: Common, shot: Shot, output: Plot = None, settings: Settings = None) -> None:
    """Draw everything in a shot that changes over time: values over frames, with their keys as dots.

    `flowsculpt curves A010_cube` writes renders/A010_cube/A010_cube.curves.svg.
    """
    path = find_shot(shot)
    keyed = curves_of(path, settings or ())
    if not keyed:
        raise UsageError(
            f"{path} has nothing that changes over time; give a number keys, such as "
            f"{{keys: {{1: 0, 24: 2}}}}"
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
