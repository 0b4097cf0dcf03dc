"""The command `why`: why a frame would be made again."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.options import Common, Quality, Settings
from pipeline.cli.output import answer
from pipeline.production.execution.project import Project
from pipeline.production.maintenance.why import Answer, Question
from pipeline.production.request.lookup import find_shot


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
    request = project.request(find_shot(shot), quality, str(frame))
    found = Question(request, frame, project.store).answer()
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
