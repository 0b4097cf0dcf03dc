"""The command `task`: a part of a plan, done by a worker of a render manager."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import exit_with, print_result
from pipeline.plugins.farm.task_runner import Part, do
from render.base.plural import plural


def task(
    common: Common,
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="The plan that `flowsculpt export plan` wrote.")
    ],
    tasks: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK...",
            help="Stages in their order: simulate, smooth_normals, frame_camera, render, finish, assemble, "
            "film; of one shot as A010_cube/render, some of its frames as render:1-8.",
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
    exit_with(code)
