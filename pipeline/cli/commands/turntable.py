"""The command turntable: an object turned before the camera, then the lights around it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import make
from pipeline.cli.options import AllowCode, Common, Quality, Scale, Settings, Variant
from pipeline.cli.output import err
from pipeline.cli.progress import counting
from pipeline.cli.projects import project_of
from pipeline.dailies.turntable.request import BOTH, Turning
from pipeline.dailies.turntable.sheets import Sheets
from pipeline.errors import UsageError
from pipeline.production.request.crop_and_scale import windowed


def turntable(
    common: Common,
    subject: Annotated[
        str, typer.Argument(metavar="SHOT|MESHFILE", help="A shot, or an OBJ, PLY, STL, OFF or GLB.")
    ],
    at: Annotated[
        int | None, typer.Option(metavar="FRAME", help="The shot's frame; by default its first.")
    ] = None,
    frames: Annotated[int, typer.Option(help="How many pictures a full turn has.")] = 72,
    turn: Annotated[
        str,
        typer.Option(metavar="WHAT", help="object, lights, or both: the object first, and then the lights."),
    ] = BOTH,
    look: Annotated[
        str | None,
        typer.Option(
            metavar="LOOKS",
            help="In place of the shot's own; of several, as in clay,glaze, a movie side by side too.",
        ),
    ] = None,
    bare: Annotated[
        bool, typer.Option("--bare", help="On the shot's own stage, without balls and colour chart.")
    ] = False,
    quality: Quality = "preview",
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Turn one frame of a shot, or a mesh file, once around before the camera, then the lights around it.

    A grey ball, a chrome one and a colour chart stand beside it. A movie and a sheet of key angles appear in
    renders/turntable. `flowsculpt turntable model.obj --look clay,glaze,chrome` makes them for each look, and
    one movie of all three side by side.
    """
    project = project_of(common, settings, allow_code, variant)
    named = windowed(quality, None, scale)
    turning = Turning(project, subject, named, at, frames, turn, _looks(look), bare)

    def draw() -> list[Path]:
        with counting(err if common.progress else None) as bar:
            return Sheets(turning).draw(bar)

    make(common, turning.plan, draw)


def _looks(text: str | None) -> tuple[str, ...]:
    if text is None:
        return ()
    looks = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not looks:
        raise UsageError("--look names no look; write one, or several as in clay,glaze,chrome")
    return looks
