"""The command `status`: which frames are done, stale and missing."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from pipeline.cli.options import Common, Settings
from pipeline.cli.output import answer, complain, duration, out
from pipeline.errors import FlowsculptError
from pipeline.production.execution.project import Project
from pipeline.production.planning.frame_states import FrameStates, states
from pipeline.production.planning.history import History
from pipeline.production.request.lookup import find_shot, shot_names
from render.scene.quality import QUALITIES


def status(
    common: Common,
    shots: Annotated[list[str] | None, typer.Argument(metavar="SHOT…", help="By default every shot.")] = None,
    settings: Settings = None,
) -> None:
    """Say of every shot which frames are done, stale and missing, at each quality that was begun.

    Failed frames failed when they were last tried; running ones are being made now. The time left is what the
    undone take if they come as fast as the last did.
    """
    project = Project(common.root, common.cores, settings=tuple(settings or ()))
    history = History.of(common.root)
    rows: list[FrameStates] = []
    failed: list[FlowsculptError] = []
    for shot in shots or shot_names():
        try:
            requests = [project.request(find_shot(shot), quality) for quality in QUALITIES]
            rows += states(requests, project.store, history)
        except FlowsculptError as error:
            failed.append(error)
    for failure in failed:
        complain(str(failure))
    _tell(rows, common.json)
    if failed:
        raise typer.Exit(max(failure.exit_code for failure in failed))


def _tell(rows: list[FrameStates], as_json: bool) -> None:
    if as_json:
        answer("", [row.as_data() for row in rows], as_json=True)
        return
    table = Table(box=None, pad_edge=False)
    columns = ["done", "stale", "missing"]
    columns += [name for name in ("failed", "running") if any(getattr(row, name) for row in rows)]
    timed = any(row.seconds_left for row in rows)
    for heading in ("shot", "what", *columns, *(["time left"] if timed else [])):
        table.add_column(heading)
    for row in rows:
        left = [] if not timed else ["–" if row.seconds_left is None else duration(row.seconds_left)]
        table.add_row(row.shot, row.what, *(str(getattr(row, name)) or "–" for name in columns), *left)
    out.print(table if rows else "No shots here; flowsculpt new makes one.")
