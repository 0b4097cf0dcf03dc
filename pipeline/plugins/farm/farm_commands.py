"""The command `task`, and the formats of `export` whose jobs call it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer
from ruamel.yaml import YAML

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import print_result, print_warning
from flowsculpt.api.files import atomic_write, disk_errors
from flowsculpt.api.frames import FrameRange, Plan, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, PictureOptions, Quality, shared_option
from flowsculpt.pipeline.plugins.farm.flamenco import JOB_TYPE, submitted_job
from flowsculpt.pipeline.plugins.farm.openjd import template
from flowsculpt.pipeline.plugins.farm.task_runner import BY_FRAMES, Part, do

FrameNumbers = Annotated[
    FrameRange | None,
    shared_option("frames", "Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Default: all."),
]

Names = Annotated[
    list[str], typer.Argument(metavar="SHOT|EDIT...", help="Shots, by name or path, or an edit.")
]

Nodes = Annotated[
    int | None,
    typer.Option(
        "--nodes",
        min=1,
        metavar="N",
        help="Divide the frames among N workers, by the time that they take. Default: `jobs` of the profile, "
        "or 100.",
    ),
]


def _file(default: str) -> Any:
    return shared_option("output", f"Write this file. Default: {default}.")


def plan(
    common: Common,
    names: Names,
    options: PictureOptions,
    output: Annotated[Path, _file("plan.json")] = Path("plan.json"),
    frames: FrameNumbers = None,
    quality: Quality = DEFAULT_QUALITY,
    nodes: Nodes = None,
) -> None:
    """Write a plan for `flowsculpt task`, which does parts of it on the workers of any render manager.

    `flowsculpt export plan A010_cube -o plan.json` freezes the shot as it is now. Tasks skip what is already
    rendered. With --json, `chunks` lists the tasks that share the frames among the workers.
    """
    _require_ending(output, "a plan", ".json")
    made = _plan(common, names, options, frames, quality, nodes)
    if not common.dry_run:
        _make_folders(common, output)
        made.write(output)
    tasks: dict[str, set[int]] = {}
    chunks: list[str] = []
    shots = {request.name for request in made.requests}
    for job in made.jobs:
        alone = len(shots) == 1 or job.stage == "film"
        shot = "" if alone else f"{made.requests[job.requests[0]].name}/"
        tasks.setdefault(shot + job.stage, set()).update(job.frames)
        chunks += [f"{shot}{job.stage}:{job.frames}"] if job.stage in BY_FRAMES else []
    numbers = {task: sorted(each) for task, each in tasks.items()}
    words = ", ".join(f"{task}:{FrameRange.of(each)}" for task, each in numbers.items())
    facts = {"plan": str(output), "tasks": numbers, "chunks": chunks, "targets": list(made.targets)}
    print_result(f"{output}: {common.done('written')}. Tasks: {words}.", facts, common.json)


def openjd(
    common: Common,
    names: Names,
    options: PictureOptions,
    output: Annotated[Path, _file("template.yaml")] = Path("template.yaml"),
    frames: FrameNumbers = None,
    quality: Quality = DEFAULT_QUALITY,
    nodes: Nodes = None,
) -> None:
    """Write a job template of Open Job Description that renders shots and assembles their movies.

    `flowsculpt export openjd A010_cube` writes template.yaml, and next to it the plan that its tasks read,
    template.yaml.plan.json: the shot as it is now. Several shots make one job, and `flowsculpt export openjd
    film` writes one of all shots of an edit and its film. `openjd run template.yaml` executes it here; a
    render manager executes it on workers, which see the root under the same path or under the parameter Root,
    or share a remote store. Tasks skip what is already rendered.
    """
    _require_ending(output, "a template", ".yaml", ".yml", ".json")
    made = _plan(common, names, options, frames, quality, nodes)
    plan_file = output.with_name(f"{output.name}.plan.json")
    share = common.profile.exported_share
    job = template(made, plan_file.name, common.root, "+".join(names), share.threads, Store(common.root).url)
    if not common.dry_run:
        _make_folders(common, output)
        made.write(plan_file)
        _write(output, partial(_yaml().dump, job))
    facts = {"template": str(output), "plan": str(plan_file), "targets": list(made.targets)}
    print_result(f"{output}, {plan_file}: {common.done('written')}.", facts, common.json)


def flamenco(
    common: Common,
    names: Names,
    options: PictureOptions,
    output: Annotated[Path, _file("flamenco.json")] = Path("flamenco.json"),
    frames: FrameNumbers = None,
    quality: Quality = DEFAULT_QUALITY,
    nodes: Nodes = None,
) -> None:
    """Write a job of Flamenco that renders shots and assembles their movies, and the job type that it has.

    `flowsculpt export flamenco A010_cube` writes flamenco.json, next to it the plan that its tasks read, and
    flowsculpt.js, which belongs in the folder scripts of Flamenco Manager. Workers see plan and root under
    the same paths, or share a remote store. Tasks skip what is already rendered.
    """
    _require_ending(output, "a job of Flamenco", ".json")
    made = _plan(common, names, options, frames, quality, nodes)
    plan_file, script = output.with_name(f"{output.name}.plan.json"), output.with_name(JOB_TYPE.name)
    root = common.root.absolute()
    job = submitted_job(made, plan_file.absolute(), root, "+".join(names), Store(root).url)
    if not common.dry_run:
        _make_folders(common, output)
        made.write(plan_file)
        _write(script, lambda file: file.write(JOB_TYPE.read_text(encoding="utf-8")))
        _write(output, partial(json.dump, job, indent=1))
    facts = {
        "job": str(output),
        "plan": str(plan_file),
        "job_type": str(script),
        "targets": list(made.targets),
    }
    print_result(f"{output}, {plan_file}, {script}: {common.done('written')}.", facts, common.json)


def _plan(
    common: Common,
    names: list[str],
    options: PictureOptions,
    frames: FrameRange | None,
    quality: str,
    nodes: int | None,
) -> Plan:
    """Return the plan of all that shots or an edit need, as if nothing was rendered."""
    project = options.project(common)
    made = project.whole(names, options.quality(quality, project, names), frames, nodes)
    for note in dict.fromkeys(made.notes):
        print_warning(note)
    return made


def _require_ending(output: Path, what: str, *endings: str) -> None:
    """Raise UsageError for a file whose name has none of the endings."""
    if output.suffix not in endings:
        known = " or ".join(endings)
        raise UsageError(f"{output}: {what}'s name ends in {known}; call it {output.stem}{endings[0]}")


def _make_folders(common: Common, output: Path) -> None:
    with disk_errors(output):
        output.parent.mkdir(parents=True, exist_ok=True)
        common.root.mkdir(parents=True, exist_ok=True)  # a worker that does not see it says so


def _write(path: Path, write: Callable[[TextIO], object]) -> None:
    """Write a text file, which appears whole or not at all."""
    with disk_errors(path), atomic_write(path) as draft, draft.open("w", encoding="utf-8") as file:
        write(file)


def _yaml() -> YAML:
    yaml = YAML()
    yaml.width = 100
    return yaml


def task(
    common: Common,
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="The plan that `flowsculpt export plan` wrote.")
    ],
    tasks: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK...",
            help="Stages in their order: simulate, smooth_normals, frame_camera, render, those of plug-ins, "
            "finish, assemble, film; of one shot as A010_cube/render, some of its frames as render:1-8.",
        ),
    ],
    part: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Do part I of N of the frames, I counted from 0, as a task of an array job does: 0/8.",
        ),
    ] = None,
) -> None:
    """Do tasks of a plan on this machine, as a worker of a render manager.

    `flowsculpt export plan A010_cube -o plan.json` freezes the shot as it is now. Then, on workers that see
    the root, `flowsculpt task plan.json simulate smooth_normals frame_camera`; `flowsculpt task plan.json
    render:1-8` and so on for all frames, in any order and side by side; the same with `finish:1-8`; and
    `flowsculpt task plan.json assemble`. In an array job of eight tasks, `flowsculpt task plan.json render
    --part 0/8` is the first.

    Workers without a shared disk share a remote store: with --store, each needs only the plan and an empty
    root, fetches the files its task reads, and uploads those it makes.

    Tasks lock no shot, and skip what the store has, so a killed task can be run again. docs/farm.md has the
    lines for OpenCue, Deadline and Tractor.
    """
    if common.dry_run:
        print_result(f"{plan}: {plural(len(tasks), 'task')} would be done.", {"tasks": tasks}, common.json)
        return
    code = do(common.root, plan, tasks, common.cores, Part.parse(part) if part else None)
    words = (
        f"{plan}: {', '.join(tasks)} done." if code == 0 else f"{plan}: some of {', '.join(tasks)} failed."
    )
    print_result(words, {"tasks": tasks, "exit_code": code}, common.json)
    raise typer.Exit(code)
