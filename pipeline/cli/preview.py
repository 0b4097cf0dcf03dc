"""Commands that show a shot without rendering it: preview, curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.arguments import AllowCode, Frames, Settings
from pipeline.cli.options import Common
from pipeline.cli.runs import carried_out, tell_plan
from pipeline.cli.say import answer
from pipeline.errors import UsageError
from pipeline.production.files.layout import Folders
from pipeline.production.runs.workflow import Studio
from pipeline.production.surfaces.preview import Sketch
from pipeline.production.takes.folder import find_shot
from pipeline.shot import read_shot
from pipeline.shot.keyed_curves import curves_of
from render.plot import Track, plot_tracks


def preview(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    at: Annotated[
        int | None, typer.Option("--at", metavar="FRAME", help="A still of this frame; by default a movie.")
    ] = None,
    frames: Frames = None,
    flow: Annotated[
        bool, typer.Option("--flow", help="Draw the flow: its streamlines at each frame, coloured by speed.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the PNG or MP4 there.")
    ] = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Show a shot quickly, without a path tracer: its own camera, lights and look, nothing reflected.

    The shot is simulated where it is not; renders use the same meshes and cameras. Pictures go to
    renders/SHOT/sketch.
    """
    if at is not None and frames is not None:
        raise UsageError("--at is for a still and --frames for a movie; give one of them")
    ending = ".mp4" if at is None else ".png"
    if output is not None and output.suffix.lower() != ending:
        raise UsageError(
            f"{output} is no {ending[1:].upper()}, which this preview is; end its name in {ending}"
        )
    studio = Studio(common.root, common.cores, None, tuple(settings or ()), allow_code, common.profile)
    chosen = str(at) if at is not None else frames
    take = studio.take(find_shot(shot), "preview", chosen, variant="none")
    if common.dry_run:
        tell_plan(common, studio.surfaces(take))
        return
    outcome = carried_out(common, lambda: studio.surfaces(take))
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)
    sketch = Sketch(take, studio.store, flow)
    path = output or common.root / sketch.place(at)
    path.parent.mkdir(parents=True, exist_ok=True)
    many = sketch.movie(path) if at is None else 1
    if at is not None:
        sketch.still(at, path)
    answer(
        f"{path}: {many} frame{'s' if many > 1 else ''}.", {"path": str(path), "frames": many}, common.json
    )


def curves(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="An SVG, PNG or PDF; by default renders/SHOT/SHOT.curves.svg.",
        ),
    ] = None,
    settings: Settings = None,
) -> None:
    """Draw everything in a shot that changes over time: values over frames, and the keys as dots."""
    path = find_shot(shot)
    found = curves_of(path, settings or ())
    if not found:
        raise UsageError(
            f"{path} has nothing that changes over time; give a number keys, as {{keys: {{1: 0, 24: 2}}}}"
        )
    clock = read_shot(path, settings=settings or ()).motion.clock
    page = output or common.root / Folders.of_shot(path.stem).cameras().parent / f"{path.stem}.curves.svg"
    if not common.dry_run:
        page.parent.mkdir(parents=True, exist_ok=True)
        tracks = [Track(c.name, c.unit, c.frames, c.values, c.keys) for c in found]
        plot_tracks(path.stem, tracks, float(clock.rate.fps), page)
    done = f"{page}: {len(found)} curves{', would be written' if common.dry_run else ''}."
    answer(done, {"path": str(page), "curves": [curve.name for curve in found]}, common.json)
