"""The command `turntable`: an object turned before the camera, then the lights around it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import execute_and_report
from pipeline.cli.options import Common, Quality, Scale, ShotOptions, Subject, Variant, at_option, words_of
from pipeline.cli.output import progress_bars
from pipeline.plugins.turntable.turntable_movie import BOTH, TurntableRequest, TurntableSheets
from pipeline.production.request.lookup import cropped_name
from render.scene.render_quality import DEFAULT_QUALITY


def turntable(
    common: Common,
    subject: Annotated[
        str,
        typer.Argument(
            metavar="SHOT|MESHFILE", help="A shot, or an OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD."
        ),
    ],
    options: ShotOptions,
    at: Annotated[int | None, at_option("The frame of the shot. Default: its first.")] = None,
    frames: Annotated[int, typer.Option(metavar="N", help="Pictures in a full turn.")] = 72,
    turn: Annotated[
        str, typer.Option(metavar="WHAT", help="object, lights, or both: the object first, then the lights.")
    ] = BOTH,
    look: Annotated[
        str | None,
        typer.Option(
            metavar="LOOKS",
            help="Replace the shot's look. Several, as in clay,glaze, also give a movie side by side.",
        ),
    ] = None,
    bare: Annotated[
        bool,
        typer.Option(
            "--bare", help="Keep the shot's own stage, without the grey ball, chrome ball and colour chart."
        ),
    ] = False,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="y|z",
            help="The axis of the mesh file that points up. Default: what it states, or z of an STL, else y.",
        ),
    ] = None,
    part: Subject = None,
    quality: Quality = DEFAULT_QUALITY,
    scale: Scale = None,
    variant: Variant = None,
) -> None:
    """Render one frame of a shot, or a mesh file, turning; then the lights turning around it.

    `flowsculpt turntable A010_cube --at 22` writes a movie and a sheet of key angles to renders/turntable.
    A grey ball, a chrome ball and a colour chart are in the picture. `flowsculpt turntable model.obj
    --look clay,glaze,chrome` renders each look, and one movie of all three side by side. For STL files
    z is up, for others y, unless `--up` sets it. Several subjects turn together; `--subject heron` turns one
    of them alone.
    """
    project = options.project(common, variant)
    named = cropped_name(quality, None, scale)
    fault = "--look names no look; write one, or several as in clay,glaze,chrome"
    looks = () if look is None else words_of(look, fault)
    request = TurntableRequest(project, subject, named, at, frames, turn, looks, bare, up, part)

    def draw() -> list[Path]:
        with progress_bars(common.progress) as bar:
            return TurntableSheets(request).draw(bar)

    execute_and_report(common, request.plan, draw)
