"""The command `export`: files that other programs read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from ruamel.yaml import YAML

from pipeline.cli.options import Common, Frames, PictureOptions, Quality, output_option, require_one_of
from pipeline.cli.output import print_result
from pipeline.dailies.delivery.timeline import MEDIA, Timeline
from pipeline.errors import UsageError
from pipeline.production.execution import openjd as job_description
from pipeline.production.execution.project import Project
from pipeline.production.request.lookup import FILM, find_edit
from render.base.atomic_write import atomic_write, disk_errors
from render.base.plural import plural
from render.scene.quality import DEFAULT_QUALITY

FORMATS = ("openjd", "otio")


def export(
    common: Common,
    form: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT",
            help="openjd: Open Job Description, for render managers; otio: OpenTimelineIO, for editors.",
        ),
    ],
    options: PictureOptions,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="SHOT|EDIT", help="openjd: a shot, by name or path. otio: an edit. Default: the film."
        ),
    ] = None,
    output: Annotated[
        Path | None, output_option("Default: template.yaml, or the edit's name and .otio.")
    ] = None,
    media: Annotated[
        str, typer.Option(metavar="NAME", help=f"Media that otio clips refer to: {', '.join(MEDIA)}.")
    ] = "frames",
    frames: Frames = None,
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Write a render manager's job, or an editing program's timeline.

    `flowsculpt export openjd A010_cube` writes a job template that renders the shot and assembles its movie,
    and beside it the plan that its tasks read, template.yaml.plan.json: the shot as it is now. `openjd run
    template.yaml` executes it here; a render manager executes it on workers, which see the root under the
    same path or under the parameter Root. Tasks skip what is already rendered.

    `flowsculpt export otio showreel -q final` writes showreel.otio: clips, dissolves, cards and sound of
    shots/showreel.yaml. Clips refer to frames, relative to the file, or to files that `flowsculpt deliver`
    wrote: `--media prores4444`.
    """
    require_one_of(form, FORMATS, f"{form!r} is not a format to export.")
    project, quality = options.project(common), options.quality(quality)
    if form == "otio":
        _timeline(common, project, quality, name or FILM.stem, output, media, frames)
    else:
        _job(common, project, quality, name, output or Path("template.yaml"), frames)


def _timeline(
    common: Common,
    project: Project,
    quality: str,
    edit: str,
    output: Path | None,
    media: str,
    frames: str | None,
) -> None:
    require_one_of(media, MEDIA, f"--media {media}: clips cannot refer to it.")
    if frames is not None:
        raise UsageError(f"-f {frames} chooses frames of shots; an edit names its own")
    path = find_edit(edit)
    place = output or Path(f"{path.stem}.otio")
    if place.suffix != ".otio":
        raise UsageError(f"{place}: a timeline's name ends in .otio; call it {place.stem}.otio")
    cut, requests = project.edit(quality, path)
    if not common.dry_run:
        Timeline(cut, requests, common.root, media, place).write()
    done = f"{place}: {plural(cut.length, 'frame')}, {common.done('written')}."
    print_result(done, {"timeline": str(place), "frames": cut.length, "media": media}, common.json)


def _job(
    common: Common, project: Project, quality: str, shot: str | None, output: Path, frames: str | None
) -> None:
    if shot is None:
        raise UsageError("export openjd needs the name of a shot; flowsculpt status lists shots")
    if output.suffix not in (".yaml", ".yml", ".json"):
        raise UsageError(
            f"{output}: a template's name ends in .yaml, .yml or .json; call it {output.stem}.yaml"
        )
    plan = project.whole(shot, quality, frames)
    beside = output.with_name(f"{output.name}.plan.json")
    made = job_description.template(plan, beside.name, common.root)
    if not common.dry_run:
        with disk_errors(output):
            output.parent.mkdir(parents=True, exist_ok=True)
            common.root.mkdir(parents=True, exist_ok=True)  # a worker that does not see it says so
            plan.write(beside)
            with atomic_write(output) as draft, draft.open("w", encoding="utf-8") as file:
                yaml = YAML()
                yaml.width = 100
                yaml.dump(made, file)
    facts = {"template": str(output), "plan": str(beside), "targets": list(plan.targets)}
    print_result(f"{output}, {beside}: {common.done('written')}.", facts, common.json)
