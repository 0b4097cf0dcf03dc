"""Commands that tell: status, doctor."""

from __future__ import annotations

import platform
import shutil
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.arguments import Quality, Settings
from pipeline.cli.options import Common
from pipeline.cli.say import answer, complain, duration, out
from pipeline.errors import FlowsculptError
from pipeline.kernels import compile_all
from pipeline.production.execution.project import Project
from pipeline.production.maintenance.why import Answer, Question
from pipeline.production.planning.frame_states import FrameStates, states
from pipeline.production.planning.history import History
from pipeline.production.request.lookup import find_shot, shot_names
from render import raster
from render.base.kernel_cache import cache_folder
from render.mitsuba import engine
from render.movie import planes
from render.post import colour
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
            takes = [project.take(find_shot(shot), quality) for quality in QUALITIES]
            rows += states(takes, project.store, history)
        except FlowsculptError as error:
            failed.append(error)
    for failure in failed:
        complain(str(failure))
    _tell(rows, common.json)
    if failed:
        raise typer.Exit(max(failure.exit_code for failure in failed))


def why(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    frame: Annotated[int, typer.Argument(metavar="FRAME", help="A frame of the shot.")],
    quality: Quality = "draft",
    settings: Settings = None,
) -> None:
    """Say why a frame would be made again, or why it is as it should be.

    Keys decide: of the mesh, of the picture, of the code. What of them differs from what is there is told
    part by part, and what was edited in the shot file since the frame was made.
    """
    project = Project(common.root, common.cores, settings=tuple(settings or ()))
    take = project.take(find_shot(shot), quality, str(frame))
    found = Question(take, frame, project.store).answer()
    answer(_explained(found, shot, frame, quality), found.as_data(), common.json)


def _explained(found: Answer, shot: str, frame: int, quality: str) -> str:
    again = f"flowsculpt render {shot} -q {quality} -f {frame}"
    if found.state == "done":
        return f"{found.place} is what the shot file asks for."
    lines = [f"{found.place} is {found.state}; {again} makes it."]
    lines += [f"  {reason}" for reason in found.reasons]
    lines += [f"  {part}" for part in found.parts]
    if found.edits:
        lines += ["Edited in the shot file since it was made:", *(f"  {edit}" for edit in found.edits)]
    return "\n".join(lines)


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


def doctor(
    common: Common,
    prepare: Annotated[
        bool, typer.Option("--prepare", help="Compile the kernels and bake the view, as set-up does.")
    ] = False,
) -> None:
    """Say what is in use here, and what would make it faster."""
    if prepare and not common.dry_run:
        compile_all()
        colour.prepare()
        planes.prepare()
        raster.prepare()
    renderer = engine.facts()
    there = next(folder for folder in (common.root, *common.root.parents) if folder.exists())
    usage = shutil.disk_usage(there)
    facts: dict[str, Any] = {
        "flowsculpt": version("flowsculpt"),
        "python": platform.python_version(),
        "cores": common.cores,
        **renderer,
        "kernels": str(cache_folder()),
        "packages": {
            name: version(name) for name in ("numba", "mitsuba", "pyoidn", "OpenImageIO", "av", "snakemake")
        },
        "root": str(common.root),
        "free_gigabytes": round(usage.free / 1e9, 1),
    }
    answer(_diagnosis(facts), facts, common.json)
    if renderer["renderer"] == "none":
        raise typer.Exit(4)


def _diagnosis(facts: dict[str, Any]) -> str:
    packages = ", ".join(f"{name} {number}" for name, number in facts["packages"].items())
    lines = [
        f"flowsculpt {facts['flowsculpt']} on Python {facts['python']}, {facts['cores']} cores",
        f"Renderer: {facts['renderer']} ({facts['why']})",
        f"Faster:   {facts['faster'] or 'nothing to be done'}",
        f"Packages: {packages}",
        f"Kernels:  {facts['kernels']}",
        f"Root:     {facts['root']}, {facts['free_gigabytes']} GB free",
    ]
    return "\n".join(lines)
