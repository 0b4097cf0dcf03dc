"""The command `film`: the film of an edit."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import make
from pipeline.cli.options import AllowCode, Common, Quality, Settings, Variant
from pipeline.cli.projects import project_of
from pipeline.production.request.lookup import FILM, find_edit


def film(
    common: Common,
    edit: Annotated[
        str, typer.Argument(help="An edit: its name in shots/, or the path of its file.")
    ] = FILM.stem,
    quality: Quality = "draft",
    variant: Variant = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Render every shot of an edit and cut them into renders/film/QUALITY/EDIT.mp4.

    Without a name it is shots/film.yaml; `flowsculpt film showreel` is shots/showreel.yaml. What is `--set`
    is set in every shot.
    """
    project = project_of(common, settings, allow_code, variant)
    make(common, lambda: project.film(quality, find_edit(edit)))
