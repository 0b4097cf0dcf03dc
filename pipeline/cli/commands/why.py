"""The command `why`: why a frame would be rendered again."""

from __future__ import annotations

import shlex
from typing import Annotated

import typer

from pipeline.cli.options import Common, Quality, Settings, Shot, project_of
from pipeline.cli.output import print_result
from pipeline.production.maintenance.why import Explanation, explain
from pipeline.production.request.lookup import find_shot
from render.scene.quality import DEFAULT_QUALITY


def why(
    common: Common,
    shot: Shot,
    frame: Annotated[int, typer.Argument(metavar="FRAME", help="A frame of the shot.")],
    quality: Quality = DEFAULT_QUALITY,
    settings: Settings = None,
) -> None:
    """Explain why a frame would be rendered again, or that it is up to date.

    `flowsculpt why A010_cube 24 -q final` compares the keys of the stored frame with those of today's shot
    file. It says what differs, from the mesh to the picture, which lines of the shot file and of the files
    that it rests on were edited since the frame was rendered, and which options --set differ.
    """
    project = project_of(common, settings)
    request = project.request(find_shot(shot), quality, str(frame))
    explanation = explain(request, frame, project.store)
    again = f"flowsculpt render {shot} -q {quality} -f {frame}"
    again += "".join(f" --set {shlex.quote(setting)}" for setting in settings or ())
    print_result(_words(explanation, again), explanation.as_data(), common.json)


def _words(explanation: Explanation, again: str) -> str:
    """Return an explanation in words; `again` is the command that makes the frame."""
    if explanation.state == "done":
        return f"{explanation.file} is what the shot file asks for."
    lines = [f"{explanation.file} is {explanation.state}; {again} makes it."]
    lines += [f"  {reason}" for reason in explanation.reasons]
    if explanation.edits:
        lines += ["Edited since it was made:", *(f"  {edit}" for edit in explanation.edits)]
    if explanation.options:
        lines += ["Options:", *(f"  {option}" for option in explanation.options)]
    if explanation.parts and not (explanation.edits or explanation.options):
        lines += ["In its header and now:", *(f"  {part}" for part in explanation.parts)]
    return "\n".join(lines)
