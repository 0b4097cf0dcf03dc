"""The command `curves`: everything in a shot that changes over time."""

from __future__ import annotations

from pipeline.cli.options import Common, Plot, Settings, Shot
from pipeline.cli.output import make_folder_of, print_result
from pipeline.errors import UsageError
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.paths import Folders
from pipeline.production.store.store import Store
from pipeline.shot import read_shot
from pipeline.shot.keyed_curves import curves_of
from render.graphics.plot import Curves, plot_panels


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
