"""Commands that show a shot without rendering it: preview, curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.arguments import AllowCode, Frames, Settings
from pipeline.cli.options import Common
from pipeline.cli.projects import project_of
from pipeline.cli.say import answer
from pipeline.cli.sketching import folder_for, sketched
from pipeline.dailies.preview.sketch import Sketch
from pipeline.errors import UsageError
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.paths import Folders
from pipeline.production.store.store import Store
from pipeline.shot import read_shot
from pipeline.shot.keyed_curves import curves_of
from render.graphics.burn_in import BurnIn
from render.graphics.panels import Track
from render.graphics.plot import plot_tracks


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
    edges: Annotated[bool, typer.Option("--edges", help="Draw the edges of the faces.")] = False,
    burn_in: Annotated[
        str | None,
        typer.Option(
            "--burn-in",
            metavar="FIELDS",
            help="Write over the picture: all, or some of shot,frame,timecode,key.",
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Open a page that shows frames while they are simulated.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Go on: look again whenever the shot file is saved.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the live page; 0 is any that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the live page in a browser.")
    ] = True,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the PNG or MP4 there.")
    ] = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Show a shot quickly, without a path tracer: its own camera, lights and look, nothing reflected.

    What is not simulated yet is simulated for the look alone; `flowsculpt simulate` keeps meshes. Pictures go
    to renders/SHOT/sketch: `flowsculpt preview A010_cube --at 22 --edges` is a still with its faces.

    `flowsculpt preview A010_cube --live --watch` is for working: a page follows the simulation frame by
    frame, and after each save from the first frame on that the edit changed. Ctrl-C ends it.
    """
    if at is not None and frames is not None:
        raise UsageError("--at is for a still and --frames for a movie; give one of them")
    ending = ".mp4" if at is None else ".png"
    if output is not None and output.suffix.lower() != ending:
        raise UsageError(
            f"{output} is no {ending[1:].upper()}, which this preview is; end its name in {ending}"
        )
    if at is not None and (live or watch):
        raise UsageError("--live and --watch show movies; leave --at out")
    path, over = find_shot(shot), None if burn_in is None else BurnIn.parse(burn_in)

    def sketch() -> tuple[Sketch, Store]:
        """As the shot is now."""
        project = project_of(common, settings, allow_code)
        take = project.take(path, "preview", str(at) if at is not None else frames, variant="none")
        return Sketch(take, flow, edges, over), project.store

    if (live or watch) and not common.dry_run:
        from pipeline.cli.watching import watched

        watched(common, path, sketch, output, watch, (port, browser) if live else None)
    else:
        sketched(common, *sketch(), at, output)


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
        folder_for(page)
        tracks = [Track(c.name, c.unit, c.frames, c.values, c.keys) for c in found]
        plot_tracks(path.stem, tracks, float(clock.rate.fps), page)
    done = f"{page}: {len(found)} curves{', would be written' if common.dry_run else ''}."
    answer(done, {"path": str(page), "curves": [curve.name for curve in found]}, common.json)
