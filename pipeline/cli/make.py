"""Commands that make files: simulate, render, stills, film."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.arguments import AllowCode, Crop, Frames, Quality, Scale, Settings, Shots, Variant
from pipeline.cli.options import Common
from pipeline.cli.projects import project_of
from pipeline.cli.runs import make
from pipeline.errors import UsageError
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import FILM, find_edit
from pipeline.production.request.render_request import FORMS
from render.scene.quality import QUALITIES


def simulate(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Simulate shots: move and resample their surfaces, frame by frame.

    Mesh frames appear in renders/SHOT/meshes. After an edit a simulation goes on from the last frame that
    the edit left valid. Vertices are numbered for life in them, and new ones name their parents; those of
    method polyhedra are not.
    """
    project = project_of(common, settings, allow_code)
    make(common, lambda: project.meshes(shots, frames))


def render(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT…", help="Names in shots/, or paths of shot files.")
    ] = None,
    frames: Frames = None,
    quality: Annotated[
        str | None,
        typer.Option("-q", "--quality", help=f"One of {', '.join(QUALITIES)}.", show_default="draft"),
    ] = None,
    provenance: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="PROVENANCE",
            help="Make a published version again from its provenance.json, and compare.",
        ),
    ] = None,
    variant: Variant = None,
    crop: Crop = None,
    scale: Scale = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Render shots, or a range of their frames, and assemble the movie.

    Only what is missing or stale is made: `flowsculpt render A010_cube -f 10-20x2 -q preview` renders six
    frames, and nothing when called again. Parts and scaled pictures have folders of their own, such as
    preview.scale50; a part shows what the whole picture does there, with other noise.

    `flowsculpt render --from renders/published/A010_cube/v001/provenance.json` makes a published version
    again in renders/repeated, from its shot file as it was then, and says which frames are the same to the
    last bit.
    """
    if provenance is not None:
        from pipeline.cli.publish import repeat

        repeat(common, provenance, frames, variant, allow_code, [shots, quality, crop, scale, settings])
        return
    if not shots:
        raise UsageError(
            "render needs the name of a shot, or --from and a provenance; flowsculpt status lists shots"
        )
    named = windowed(quality or "draft", crop, scale)
    project = project_of(common, settings, allow_code, variant)
    make(common, lambda: project.pictures(shots, named, frames))


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
