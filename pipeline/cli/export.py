"""The command that writes what other programs run: export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from ruamel.yaml import YAML

from pipeline.cli.arguments import AllowCode, Crop, Frames, Quality, Scale, Settings, Variant
from pipeline.cli.options import Common
from pipeline.cli.say import answer
from pipeline.errors import UsageError, suggestion
from pipeline.production.farm import openjd as job_description
from pipeline.production.files.disk import disk_faults
from pipeline.production.runs.workflow import Studio
from pipeline.production.takes.window import windowed

FORMATS = ("openjd",)


def export(
    common: Common,
    form: Annotated[
        str, typer.Argument(metavar="FORMAT", help="openjd: Open Job Description, for render managers.")
    ],
    shot: Annotated[str, typer.Argument(metavar="SHOT", help="Its name in shots/, or the path of its file.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Where the template is written.")
    ] = Path("template.yaml"),
    frames: Frames = None,
    quality: Quality = "draft",
    variant: Variant = None,
    crop: Crop = None,
    scale: Scale = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Write a render manager's job: a template that renders a shot and assembles its movie.

    Beside FILE goes the frozen plan that its tasks read, FILE.plan.json: edits of the shot after this are
    not in it. `openjd run template.yaml` does the work here, a render manager on its workers, which see the
    root under its path or under the one given as parameter Root. What is done stays done: tasks find it.
    """
    if form not in FORMATS:
        raise UsageError(f"{form!r} is no format to export. {suggestion(form, FORMATS)}")
    if output.suffix not in (".yaml", ".yml", ".json"):
        raise UsageError(
            f"{output}: a template's name ends in .yaml, .yml or .json; call it {output.stem}.yaml"
        )
    quality = windowed(quality, crop, scale)
    studio = Studio(common.root, common.cores, variant, tuple(settings or ()), allow_code)
    plan = studio.whole(shot, quality, frames)
    beside = output.with_name(f"{output.name}.plan.json")
    made = job_description.template(plan, beside.name, common.root)
    if not common.dry_run:
        with disk_faults(output):
            output.parent.mkdir(parents=True, exist_ok=True)
            common.root.mkdir(parents=True, exist_ok=True)  # a worker that does not see it says so
            plan.write(beside)
            with output.open("w", encoding="utf-8") as file:
                yaml = YAML()
                yaml.width = 100
                yaml.dump(made, file)
    done = f"{output}, {beside}: {'would be ' if common.dry_run else ''}written."
    answer(done, {"template": str(output), "plan": str(beside), "targets": list(plan.targets)}, common.json)
