"""The command `film`: the film of an edit."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import execute_and_report
from pipeline.cli.options import Common, Force, Quality, ShotOptions, Variant
from pipeline.production.request.lookup import FILM, find_edit
from render.scene.quality import DEFAULT_QUALITY


def film(
    common: Common,
    options: ShotOptions,
    edit: Annotated[
        str, typer.Argument(metavar="EDIT", help="An edit: its name in shots/, or the path of its file.")
    ] = FILM.stem,
    quality: Quality = DEFAULT_QUALITY,
    variant: Variant = None,
    force: Force = False,
) -> None:
    """Render every shot of an edit and cut them into a film.

    `flowsculpt film` renders shots/film.yaml to renders/film/draft/film.mp4; `flowsculpt film showreel -q
    final` renders shots/showreel.yaml to renders/film/final/showreel.mp4. `--set` holds for every shot.
    """
    project = options.project(common, variant)
    project = project.forcing("render") if force else project
    execute_and_report(common, lambda: project.film(quality, find_edit(edit)))
