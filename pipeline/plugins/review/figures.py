"""The commands `figures` and `curves`: measures of a shot's meshes, and its keys, over its frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api.commands import Project, print_result
from flowsculpt.api.files import make_folder
from flowsculpt.api.frames import Folders, PipelineStage, RenderRequest, Runs, Show, Store
from flowsculpt.api.meshes import Floats
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Quality, Shot, ShotOptions, shared_option
from flowsculpt.api.shots import read_shot
from flowsculpt.pipeline.plugins.review.figure_panels import FigurePanel, HeatMap, StackedBars
from flowsculpt.pipeline.plugins.review.keyed_curves import curves_of
from flowsculpt.pipeline.plugins.review.measures import TIMED_STAGES, Crossings, limits_of, measured
from flowsculpt.pipeline.plugins.review.plot import Curves, plot_panels

LONGEST_BAR = 1.6
"""The axis of seconds ends at this multiple of the 90th percentile, for first frames compile kernels."""


def figures(
    common: Common,
    shot: Shot,
    options: ShotOptions,
    quality: Quality = DEFAULT_QUALITY,
    output: Annotated[
        Path | None,
        shared_option("output", "Write this SVG, PNG or PDF. Default: an SVG in renders/SHOT."),
    ] = None,
    crossings: Crossings = False,
    subject: Annotated[
        str | None,
        typer.Option("--subject", metavar="NAME", help="One of the shot's subjects, if it has several."),
    ] = None,
) -> None:
    """Plot the measures and times of a shot's meshes over its frames.

    `flowsculpt figures A010_cube` writes renders/A010_cube/A010_cube.figures.svg: vertices, splits and
    collapses, edge lengths, roundness of triangles, area and volume of all mesh frames simulated so far, and
    crossings where there are any. The seconds of rendering are those of `--quality`. Several subjects have a
    page each.
    """
    project = options.project(common)
    whole = project.request(Show().find_shot(shot), quality, variant="none").of_subject(subject)
    if output is not None and len(whole.parts) > 1:
        raise UsageError(f"-o {output} is one file, but {whole.name} has several subjects; choose --subject")
    drawn = [_drawn(common, project, request, output, crossings) for request in whole.parts]
    if not any(measured for _, _, measured in drawn):
        raise MissingInputError(
            f"{whole.name} has no meshes to measure; flowsculpt simulate {shot} makes them"
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
    latest = Runs(common.root)
    seconds = latest.stage_seconds(request.folders.title, request.name, request.quality_name, TIMED_STAGES)
    if rendered := latest.render_seconds(request):
        seconds["render"] = {number: sum(parts.values()) for number, parts in rendered.items()}
    drawn = panels(numbers, measures, limits_of(request), seconds)
    if not common.dry_run:
        heading, rate = request.shot.heading, float(request.shot.rate.fps)
        title = f"{heading}: {request.source.subject}" if request.source.subject else heading
        project.store.write(page, lambda path: plot_panels(title, drawn, rate, path))
    return page, [panel.name for panel in drawn], sorted(measures)


Row = Mapping[str, Any]  # the measures of one frame, by name


def panels(
    numbers: Sequence[int],
    measures: Mapping[int, Row],
    limits: tuple[float | None, float | None],
    seconds: Mapping[str, Mapping[int, float]],
) -> list[FigurePanel]:
    """Return the panels of a shot from measures by frame, and seconds by stage and frame.

    limits  minimum and maximum edge length, if they are numbers
    """
    frames = np.array(numbers, np.float64)
    rows = [measures.get(number, {}) for number in numbers]
    return [*_mesh_panels(frames, rows, limits), *_seconds_panel(frames, numbers, seconds)]


def _mesh_panels(
    frames: Floats, rows: Sequence[Row], limits: tuple[float | None, float | None]
) -> Iterator[FigurePanel]:
    def values(*names: str) -> Floats:
        found = [[row.get(name) for name in names] for row in rows]
        return np.array([[v if isinstance(v, (int, float)) else np.nan for v in row] for row in found], float)

    none = np.zeros((0, 2))
    if _has(vertices := values("vertices")):
        faces = values("faces")[:, 0]
        told = {"triangles": faces} if np.nansum(faces) else {}
        yield Curves("vertices", "", frames, vertices, none, told)
    if _has(changes := values("splits", "collapses")):
        bars = {"splits": changes[:, 0], "collapses": -changes[:, 1]}
        yield StackedBars("splits and collapses", "a frame", frames, bars)
    if (top := next((row["edge_top"] for row in rows if row.get("edge_top")), None)) is not None:
        levels = tuple((value, word) for value, word in zip(limits, ("min", "max"), strict=True) if value)
        shares, told = _shares(rows, "edges"), {"on average": values("mean_edge")[:, 0]}
        yield HeatMap("edge lengths", "scene units", frames, shares, float(top), levels, told=told)
    if any(row.get("quality") for row in rows):
        unit, worst = "1: equilateral; a hundredth is below the line", values("worst")[:, 0]
        yield HeatMap("roundness of triangles", unit, frames, _shares(rows, "quality"), 1.0, line=worst)
    for name, unit in (("area", "scene units²"), ("volume", "scene units³")):
        if _has(found := values(name)):
            first = found[np.isfinite(found)][0]
            told = {"% of the first": 100.0 * found[:, 0] / first} if first else {}
            yield Curves(name, unit, frames, found, none, told)
    crossings = values("crossings")
    if np.nansum(crossings) > 0:
        counted = np.isfinite(crossings[:, 0])
        unit = "pairs of faces" if counted.all() else "pairs of faces, counted in the frames with a dot"
        dots = np.column_stack([frames, crossings])[counted]
        keys = none if counted.all() else dots
        yield Curves("crossings", unit, dots[:, 0], dots[:, 1:], keys)


def _seconds_panel(
    frames: Floats, numbers: Sequence[int], seconds: Mapping[str, Mapping[int, float]]
) -> Iterator[FigurePanel]:
    timed = [stage for stage in PipelineStage.all() if stage in seconds]
    bars = {stage: np.array([seconds[stage].get(n, 0.0) for n in numbers]) for stage in timed}
    if not bars:
        return
    total = np.sum(list(bars.values()), axis=0)
    longest = LONGEST_BAR * float(np.quantile(total, 0.9))
    is_cut = bool(longest) and (total > longest).any()
    unit, top = ("s (the longest cut short)", longest) if is_cut else ("s", None)
    named = {PipelineStage.all()[stage].doing: values for stage, values in bars.items()}
    yield StackedBars("seconds a frame", unit, frames, named, top, {"s in all": total})


def _has(values: Floats) -> bool:
    return bool(np.isfinite(values).any())


def _shares(rows: Sequence[Row], name: str) -> Floats:
    """Return histograms (T, B); zeros for frames without one."""
    bins = next(len(row[name]) for row in rows if row.get(name))
    return np.array([row.get(name) or [0.0] * bins for row in rows], np.float64)


def curves(
    common: Common,
    shot: Shot,
    output: Annotated[
        Path | None,
        shared_option("output", "Write this SVG, PNG or PDF. Default: an SVG in renders/SHOT."),
    ] = None,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
) -> None:
    """Draw everything in a shot that changes over time: values over frames, with their keys as dots.

    `flowsculpt curves A010_cube` writes renders/A010_cube/A010_cube.curves.svg.
    """
    path = Show().find_shot(shot)
    keyed = curves_of(path, settings or ())
    if not keyed:
        raise UsageError(
            f"{path} has nothing that changes over time; give a number keys, such as "
            f"{{keys: {{1: 0, 24: 2}}}}"
        )
    clock = read_shot(path, settings=settings or ()).motion.clock
    page = output or common.root / Folders.of_shot(path.stem).home / f"{path.stem}.curves.svg"
    if not common.dry_run:
        make_folder(page.parent)
        tracks = [Curves(c.name, c.unit, c.frames, c.values, c.keys) for c in keyed]
        store, rate = Store(common.root), float(clock.rate.fps)
        store.write(page, lambda draft: plot_panels(path.stem, tracks, rate, draft))
    words = f"{page}: {len(keyed)} curves{', would be written' if common.dry_run else ''}."
    print_result(words, {"path": str(page), "curves": [curve.name for curve in keyed]}, common.json)
