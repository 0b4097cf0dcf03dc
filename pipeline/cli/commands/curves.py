"""The command `curves`: everything in a shot that changes over time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.commands.preview import folder_for
from pipeline.cli.options import Common, Settings
from pipeline.cli.output import answer
from pipeline.errors import UsageError
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.paths import Folders
from pipeline.shot import read_shot
from pipeline.shot.keyed_curves import curves_of
from render.graphics.panels import Track
from render.graphics.plot import plot_tracks


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
