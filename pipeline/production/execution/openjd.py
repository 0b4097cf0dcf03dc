"""A plan as a job template of Open Job Description 2023-09, which render managers such as Deadline Cloud run.

Its steps do what Snakemake's rules do, each by
`python -m pipeline.production.execution.openjd ROOT PLAN JOB…` on a worker that sees the root: the shot's
surfaces in one task, its frames in chunks of any numbers, its movie. They share the frozen plan and the
store, take no lock, and find what others have made.
Source: https://github.com/OpenJobDescription/openjd-specifications/wiki (2023-09 Template Schemas).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError
from pipeline.frames import FrameRange
from pipeline.production.execution.task import do
from pipeline.production.planning.plan import Plan
from pipeline.production.planning.timings import LEAST_MIB

SURFACES = ("simulate", "smooth_normals", "frame_camera")
"""One after the other in one task: only the first is worth a place in a queue."""

CHUNK = 8
"""Frames that a task makes until the manager knows how long one takes."""

CHUNK_SECONDS = 900
"""Target length of a task: tasks lose nothing when killed, but each starts a renderer."""

NOTICE_SECONDS = 15
"""Time that a cancelled task has to keep the samples of its frame."""


def template(plan: Plan, plan_file: str, root: Path) -> dict[str, Any]:
    """The job template of a whole plan of one shot.

    plan_file  where the frozen plan lies, relative to the template
    """
    steps = [
        _step("Surfaces", [job.name for job in plan.jobs if job.stage in SURFACES], None),
        _frames_step("Render", plan, "render", after="Surfaces"),
        _frames_step("Finish", plan, "finish", after="Render"),
        _step("Assemble", [job.name for job in plan.jobs if job.stage == "assemble"], "Finish"),
    ]
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "extensions": ["TASK_CHUNKING"],
        "name": f"flowsculpt {Path(plan.targets[-1]).stem}",
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
                "name": "Python",
                "type": "STRING",
                "default": sys.executable,
                "description": "The Python that flowsculpt is installed for on the workers.",
            },
        ],
        "steps": steps,
    }


def _step(name: str, jobs: Sequence[str], after: str | None) -> dict[str, Any]:
    words = ["-m", "pipeline.production.execution.openjd", "{{Param.Root}}", "{{Param.Plan}}", *jobs]
    action = {
        "command": "{{Param.Python}}",
        "args": words,
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": NOTICE_SECONDS},
    }
    return {
        "name": name,
        **({"dependencies": [{"dependsOn": after}]} if after else {}),
        "hostRequirements": {"amounts": [{"name": "amount.worker.memory", "min": LEAST_MIB}]},
        "script": {"actions": {"onRun": action}},
    }


def _frames_step(name: str, plan: Plan, task: str, after: str) -> dict[str, Any]:
    numbers = sorted({number for job in plan.jobs if job.stage == task for number in job.frames})
    frames = {
        "name": "Frame",
        "type": "CHUNK[INT]",
        "range": _written(numbers),
        "chunks": {
            "defaultTaskCount": CHUNK,
            "targetRuntimeSeconds": CHUNK_SECONDS,
            "rangeConstraint": "NONCONTIGUOUS",
        },
    }
    step = _step(name, [f"{task}:{{{{Task.Param.Frame}}}}"], after)
    return {**step, "parameterSpace": {"taskParameterDefinitions": [frames]}}


def _written(numbers: Iterable[int]) -> str:
    """Frames in Open Job Description's words, where `1-9:2` is what artists write as `1-9x2`."""
    return str(FrameRange.of(numbers)).replace("x", ":")


def main(root: str, plan: str, *jobs: str) -> int:
    """Do jobs of a plan in a root, one after the other until one fails; `render:1-9:2` is every second."""
    tasks = [f"{stage}{colon}{frames.replace(':', 'x')}" for stage, colon, frames in map(_parted, jobs)]
    return do(Path(root), Path(plan), tasks)


def _parted(job: str) -> tuple[str, str, str]:
    return job.partition(":")


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except FlowsculptError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
