"""The command `stills`: frames as PNG or JPEG."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import execute_and_report
from pipeline.cli.options import Common, Frames, PictureOptions, Quality, Shots
from pipeline.production.request.render_request import FORMS
from render.scene.quality import DEFAULT_QUALITY


def stills(
    common: Common,
    shots: Shots,
    options: PictureOptions,
    frames: Frames = None,
    quality: Quality = DEFAULT_QUALITY,
    form: Annotated[
        str,
        typer.Option(
            "--as", metavar="FORM", help=f"One of {', '.join(FORMS)}: 8 bits, 16 bits, or 8 bits compressed."
        ),
    ] = "png",
) -> None:
    """Write frames of shots as PNG or JPEG, rendering what is missing.

    `flowsculpt stills A010_cube -f 40` writes one final frame to renders/A010_cube/final/png.

    Stills have the shot's exposure and view transform. Frames in linear EXR, with all AOVs, lie in
    renders/SHOT/QUALITY/frames and raw.
    """
    project, quality = options.project(common), options.quality(quality)
    execute_and_report(common, lambda: project.stills(shots, form, quality, frames))
