"""The commands `status`, `report` and `why`.

They list which frames are done, where the time of a run went, and why a frame would be rendered again.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group

from flowsculpt import FlowsculptError
from flowsculpt.api import plural
from flowsculpt.api.commands import (
    Project,
    duration_words,
    empty_table,
    print_error,
    print_result,
    print_warning,
)
from flowsculpt.api.frames import FrameRange, FrameStates, QualityName, RenderRequest, Show
from flowsculpt.api.options import (
    DEFAULT_QUALITY,
    Common,
    Quality,
    Shot,
    ShotOptions,
    shared_option,
)
from flowsculpt.pipeline.plugins.maintenance.run_report import LABELS, RunReport, named_run

if TYPE_CHECKING:
    from flowsculpt.pipeline.plugins.maintenance.why import Explanation


def status(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT", help="Names or paths of shots. Default: all.")
    ] = None,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
) -> None:
    """List which frames of shots are done, stale and missing, at each quality begun so far.

    `flowsculpt status A010_cube` lists one shot. Stale frames were made from an older shot file. Unframed
    frames are stale only if their camera moves, which the next run frames first. Rendered frames are not
    denoised yet. Remote frames are in the remote store (--store) and not here; the next run fetches them.
    Failed frames failed at the last attempt; running frames are being rendered. The time left assumes that
    frames take as long as the last ones did.
    """
    project = ShotOptions(settings).project(common)
    rows: list[FrameStates] = []
    errors: list[FlowsculptError] = []
    for warning in () if shots else Show().misnamed().values():
        print_warning(warning)
    for shot in shots or Show().shots():
        try:
            request = project.request(Show().find_shot(shot), DEFAULT_QUALITY)
            rows += states(project, request)
        except FlowsculptError as error:
            errors.append(error)
            print_error(str(error))
    if rows or common.json or not errors:
        _report(rows, common.json)
    raise typer.Exit(max((error.exit_code for error in errors), default=0))


def states(project: Project, shot: RenderRequest) -> list[FrameStates]:
    """Return the states of a shot's meshes, and of its pictures at every quality that was begun.

    Stale frames are compared with every convention of layers.
    """
    store, history = project.store, project.history
    found = [FrameStates.of_meshes(shot, store, history)]
    for request in (replace(shot, quality_name=name) for name in QualityName.names()):
        if (store.root / request.folders.home / request.quality_name).exists():
            row = FrameStates.of_pictures(request, store, history)
            found.append(
                FrameStates.of_pictures(project.as_finished(request), store, history) if row.stale else row
            )
    return found


def _report(rows: list[FrameStates], as_json: bool) -> None:
    rare = ("rendered", "remote", "unframed", "failed", "running")
    columns = [
        "done",
        "stale",
        "missing",
        *(name for name in rare if any(getattr(row, name) for row in rows)),
    ]
    timed = any(row.seconds_left for row in rows)
    listing = empty_table("shot", "what", *columns, *(["time left"] if timed else []))
    for row in rows:
        left = [] if not timed else ["–" if row.seconds_left is None else duration_words(row.seconds_left)]
        listing.add_row(row.shot, row.what, *(str(getattr(row, name)) or "–" for name in columns), *left)
    words = listing if rows else "No shots here; flowsculpt new makes one."
    print_result(words, [row.as_data() for row in rows], as_json)


def report(
    common: Common,
    run: Annotated[
        str | None,
        typer.Argument(
            metavar="RUN", help="The name of its log in .flowsculpt/events. Default: the last run."
        ),
    ] = None,
) -> None:
    """Show where the CPU seconds of a run went, stage by stage, and how much no frame accounts for.

    `flowsculpt report` shows the last run of this root; `flowsculpt report --json` the same as numbers.
    Waiting is wall time minus CPU seconds divided by threads: other programs had the cores, the disk was
    slow, or not all threads had work. Logs of earlier versions hold no CPU seconds; what they show instead,
    wall time on all threads, is marked with ≤.
    """
    spending = RunReport.of(common.root, named_run(common.root, run), common.cores)
    listing = empty_table("", "CPU seconds", "of all", "waiting", "frames")
    for column in listing.columns[1:]:
        column.justify = "right"
    mark = "" if spending.is_counted else "≤ "
    for what, share in spending.shares.items():
        cpu, waiting = f"{mark}{spending.cpu_seconds[what]:.1f}", spending.waiting.get(what)
        waited = "" if waiting is None else f"{waiting:.1f} s"
        listing.add_row(LABELS[what], cpu, f"{share:.1%}", waited, str(spending.frames.get(what, "")))
    print_result(Group(_title(spending), listing), spending.as_data(), common.json)


def _title(spending: RunReport) -> str:
    """Return how long a run took, and how much of the cores it had."""
    length, share = f"{spending.run}: {duration_words(spending.seconds)}", spending.share_of_cores
    if spending.on_farm:
        return f"{length} on a farm"
    title = f"{length} on {plural(spending.cores, 'core')}"
    if not spending.is_counted:
        return f"{title}, logged by a version that counted no CPU seconds"
    return title if share is None else f"{title}, {share:.0%} of them used"


def why(
    common: Common,
    shot: Shot,
    frame: Annotated[
        int | None,
        typer.Argument(metavar="FRAME", help="A frame of the shot. Default: the first not up to date."),
    ] = None,
    quality: Quality = DEFAULT_QUALITY,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
) -> None:
    """Explain why a frame would be rendered again, or that it is up to date.

    `flowsculpt why A010_cube 24 -q final` compares the keys of the stored frame with those of today's shot
    file. It says what differs, from the mesh to the picture, which lines of the shot file and of the files
    that it rests on were edited since the frame was rendered, and which options --set differ. Without a frame
    it explains the first that is not up to date.
    """
    from flowsculpt.pipeline.plugins.maintenance.why import (  # loads numpy and OpenImageIO
        explain,
        first_undone,
    )

    project, path = ShotOptions(settings).project(common), Show().find_shot(shot)
    asked = None if frame is None else FrameRange([frame])
    request = project.as_finished(project.request(path, quality, asked))
    number = first_undone(project, request) if frame is None else frame
    if number is None:
        words = f"All frames of {request.name} at {quality} are what the shot file asks for."
        print_result(words, {"state": "done", "frame": None}, common.json)
        return
    explanation = explain(project, request, number)
    again = f"flowsculpt render {shot} -q {quality} -f {number}"
    again += "".join(f" --set {shlex.quote(setting)}" for setting in settings or ())
    print_result(_words(explanation, again), {"frame": number, **explanation.as_data()}, common.json)


def _words(explanation: Explanation, again: str) -> str:
    """Return an explanation in words; `again` is the command that makes the frame."""
    lines = [f"{explanation.file} is what the shot file asks for."]
    if explanation.state != "done":
        lines = [f"{explanation.file} is {explanation.state}; {again} makes it."]
    lines += [f"  {reason}" for reason in explanation.reasons]
    if explanation.edits:
        lines += ["Edited since it was made:", *(f"  {edit}" for edit in explanation.edits)]
    if explanation.options:
        lines += ["Options:", *(f"  {option}" for option in explanation.options)]
    if explanation.parts and not (explanation.edits or explanation.options):
        lines += ["In its header and now:", *(f"  {part}" for part in explanation.parts)]
    return "\n".join(lines)
