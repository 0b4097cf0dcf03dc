"""The command `why`: why a frame would be rendered again."""

from __future__ import annotations

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
    file. It lists what differs in the mesh, the picture and the stages, and which lines of the shot file were
    edited since the frame was rendered.
    """
    project = project_of(common, settings)
    request = project.request(find_shot(shot), quality, str(frame))
    found = explain(request, frame, project.store)
    print_result(_explanation(found, shot, frame, quality), found.as_data(), common.json)


def _explanation(found: Explanation, shot: str, frame: int, quality: str) -> str:
    again = f"flowsculpt render {shot} -q {quality} -f {frame}"
    if found.state == "done":
        return f"{found.file} is what the shot file asks for."
    lines = [f"{found.file} is {found.state}; {again} makes it."]
    lines += [f"  {reason}" for reason in found.reasons]
    lines += [f"  {part}" for part in found.parts]
    if found.edits:
        lines += ["Edited in the shot file since it was made:", *(f"  {edit}" for edit in found.edits)]
    return "\n".join(lines)
