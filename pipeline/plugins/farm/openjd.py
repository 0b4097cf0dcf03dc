"""A plan as a job template of Open Job Description 2023-09, which render managers such as Deadline Cloud run.

Its steps do what Snakemake's rules do, each by
`python -m flowsculpt.pipeline.plugins.farm.openjd ROOT PLAN STORE JOB…` on a worker that sees the root, or
the remote store: the surfaces of a shot in one task, its frames in chunks of any numbers, its movie; then the
film. They share the frozen plan and the store, take no lock, and find what others have made.
Source: https://github.com/OpenJobDescription/openjd-specifications/wiki (2023-09 Template Schemas).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError
from flowsculpt.api.files import python_command
from flowsculpt.api.frames import FrameRange, Plan
from flowsculpt.pipeline.plugins.farm.farm_steps import FarmStep, steps_of
from flowsculpt.pipeline.plugins.farm.task_runner import do

TIME_MARGIN = 4
"""Time limit of a task, as a multiple of its target length: nodes differ, and so do frames."""

NOTICE_SECONDS = 15  # time that a cancelled task has to keep the samples of its frame

MOST_LETTERS = 64  # letters of the name of a job or a step, by the specification


def template(
    plan: Plan, plan_file: str, root: Path, name: str, threads: int, store: str | None
) -> dict[str, Any]:
    """Return the job template of a whole plan.

    plan_file  where the frozen plan lies, relative to the template
    root       where outputs lie, as workers see it
    threads    cores that a task asks for
    store      the address of the remote store, if workers share one
    """
    steps = steps_of(plan)
    names = [_name(step, number) for number, step in enumerate(steps)]
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "extensions": ["TASK_CHUNKING"],
        "name": f"flowsculpt {name}"[:MOST_LETTERS],
        "parameterDefinitions": [
            {
                "name": "Root",
                "type": "STRING",  # of a PATH the specification wants a default below the template's folder
                "default": str(root),
                "description": "Where outputs and the store lie, as the workers see it.",
            },
            {
                "name": "Plan",
                "type": "PATH",
                "objectType": "FILE",
                "dataFlow": "IN",
                "default": plan_file,
                "description": "The frozen plan that was written beside this template.",
            },
            {
                "name": "Store",
                "type": "STRING",
                "default": store or "",
                "description": "The remote store, where workers have roots of their own; or nothing.",
            },
            {
                "name": "Python",
                "type": "STRING",
                "default": python_command("")[0],
                "description": "The Python that flowsculpt is installed for on the workers.",
            },
        ],
        "steps": [_step(step, number, names, threads) for number, step in enumerate(steps)],
    }


def _step(step: FarmStep, number: int, names: Sequence[str], threads: int) -> dict[str, Any]:
    """Return a step of the template; `names` are those of all steps."""
    tasks = [job.name for job in step.jobs]
    seconds = 60 * step.minutes(threads)
    space: dict[str, Any] = {}
    if step.frames:
        tasks, seconds = [f"{step.task}:{{{{Task.Param.Frame}}}}"], seconds + TIME_MARGIN * step.chunk_seconds
        space = {"parameterSpace": {"taskParameterDefinitions": [_chunks(step)]}}
    given = ["{{Param.Root}}", "{{Param.Plan}}", "{{Param.Store}}"]
    action = {
        "command": "{{Param.Python}}",
        "args": python_command("flowsculpt.pipeline.plugins.farm.openjd", *given, *tasks)[1:],
        "timeout": seconds,
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": NOTICE_SECONDS},
    }
    amounts = {"vcpu": threads, "memory": step.memory_mib, "gpu": step.gpus}  # memory in MiB
    least = [{"name": f"amount.worker.{name}", "min": amount} for name, amount in amounts.items() if amount]
    after = [{"dependsOn": names[other]} for other in step.after]
    return {
        "name": names[number],
        **({"dependencies": after} if after else {}),
        "hostRequirements": {"amounts": least},
        **space,
        "script": {"actions": {"onRun": action}},
    }


def _chunks(step: FarmStep) -> dict[str, Any]:
    """Return the parameter of a step whose tasks make some of its frames each.

    A manager that measures how long frames take keeps to the time that makes all nodes end together.
    """
    return {
        "name": "Frame",
        "type": "CHUNK[INT]",
        "range": _written(step.frames),
        "chunks": {
            "defaultTaskCount": step.chunk,
            "targetRuntimeSeconds": step.chunk_seconds,
            "rangeConstraint": "NONCONTIGUOUS",
        },
    }


def _name(step: FarmStep, number: int) -> str:
    """Return `Render A010_cube`; a name that is too long ends in the step's number."""
    name = f"{step.kind} {step.shot}".strip()
    return name if len(name) <= MOST_LETTERS else f"{name[: MOST_LETTERS - 6]}~{number}"


def _written(numbers: Iterable[int]) -> str:
    """Frames in Open Job Description's words, where `1-9:2` is what artists write as `1-9x2`."""
    return str(FrameRange.of(numbers)).replace("x", ":")


def main(root: str, plan: str, store: str, *jobs: str) -> int:
    """Do jobs of a plan in a root, one after the other until one fails; `render:1-9:2` is every second."""
    if store:
        os.environ["FLOWSCULPT_STORE"] = store
    named = [job.partition(":") for job in jobs]
    tasks = [f"{stage}{colon}{frames.replace(':', 'x')}" for stage, colon, frames in named]
    return do(Path(root), Path(plan), tasks)


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except FlowsculptError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
