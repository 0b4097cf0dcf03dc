"""The format `otio` of the command `export`: the timeline of an edit for editing programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Common, Quality, ShotOptions, output_option, require_one_of
from pipeline.cli.output import print_result
from pipeline.errors import UsageError
from pipeline.plugins.delivery.timeline import MEDIA, Timeline
from pipeline.production.request.lookup import FILM, find_edit
from render.base.plural import plural
from render.scene.render_quality import DEFAULT_QUALITY


def otio(
    common: Common,
    options: ShotOptions,
    edit: Annotated[
        str, typer.Argument(metavar="EDIT", help="An edit: its name in shots/, or the path of its file.")
    ] = FILM.stem,
    output: Annotated[Path | None, output_option("Write this file. Default: EDIT.otio.")] = None,
    media: Annotated[
        str, typer.Option(metavar="NAME", help=f"What clips refer to: {', '.join(MEDIA)}.")
    ] = "frames",
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Write the timeline of an edit for editing programs, in OpenTimelineIO.

    `flowsculpt export otio showreel -q final` writes showreel.otio: clips, dissolves, cards and sound of
    shots/showreel.yaml. Clips refer to frames, relative to the file, or to files that `flowsculpt deliver`
    wrote: `--media prores4444`.
    """
    require_one_of(media, MEDIA, f"--media {media}: clips cannot refer to it.")
    project = options.project(common)
    path = find_edit(edit)
    place = output or Path(f"{path.stem}.otio")
    if place.suffix != ".otio":
        raise UsageError(f"{place}: a timeline's name ends in .otio; call it {place.stem}.otio")
    cut, requests = project.edit(quality, path)
    if not common.dry_run:
        Timeline(cut, requests, common.root, media, place).write()
    done = f"{place}: {plural(cut.length, 'frame')}, {common.done('written')}."
    print_result(done, {"timeline": str(place), "frames": cut.length, "media": media}, common.json)
