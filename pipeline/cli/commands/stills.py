"""The command `stills`: frames as pictures that any program shows."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import make
from pipeline.cli.options import AllowCode, Common, Crop, Frames, Quality, Scale, Settings, Shots, Variant
from pipeline.cli.projects import project_of
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.render_request import FORMS


def stills(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    quality: Quality = "final",
    form: Annotated[
        str,
        typer.Option("--as", help=f"One of {', '.join(FORMS)}: 8 bits, 16 bits, or 8 bits compressed."),
    ] = "png",
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Write frames of shots as pictures that any program shows, rendering what is missing.

    They are seen through the shot's view and exposure and lie in renders/SHOT/QUALITY/FORM.
    `flowsculpt stills A010_cube -f 40` is a final still. The frames themselves, linear EXR with all layers,
    are in renders/SHOT/QUALITY/frames and raw.
    """
    quality = windowed(quality, crop, scale)
    project = project_of(common, settings, allow_code, variant)
    make(common, lambda: project.stills(shots, form, quality, frames))
