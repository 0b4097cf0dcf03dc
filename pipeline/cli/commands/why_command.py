"""The command `why`: why a frame would be rendered again."""

from __future__ import annotations

import shlex
from typing import Annotated

import typer

from pipeline.cli.options import Common, Quality, Settings, Shot, project_of
from pipeline.cli.output import print_result
from pipeline.production.maintenance.why import Explanation, explain, first_undone
from pipeline.production.request.lookup import find_shot
from render.scene.quality import DEFAULT_QUALITY


def why(
    common: Common,
    shot: Shot,
    frame: Annotated[
        int | None,
        typer.Argument(metavar="FRAME", help="A frame of the shot. Default: the first not up to date."),
    ] = None,
    quality: Quality = DEFAULT_QUALITY,
    settings: Settings = None,
) -> None:
    """Explain why a frame would be rendered again, or that it is up to date.

    `flowsculpt why A010_cube 24 -q final` compares the keys of the stored frame with those of today's shot
    file. It says what differs, from the mesh to the picture, which lines of the shot file and of the files
    that it rests on were edited since the frame was rendered, and which options --set differ. Without a frame
    it explains the first that is not up to date.
    """
    project, path = project_of(common, settings), find_shot(shot)
    request = project.as_finished(project.request(path, quality, None if frame is None else str(frame)))
    number = first_undone(request, project.store) if frame is None else frame
    if number is None:
        words = f"All frames of {request.name} at {quality} are what the shot file asks for."
        print_result(words, {"state": "done", "frame": None}, common.json)
        return
    explanation = explain(request, number, project.store)
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
