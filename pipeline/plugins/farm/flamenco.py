"""A plan as a job of Flamenco 3, Blender's render manager, by the job type in `flowsculpt.js`.

Flamenco Manager compiles a job into tasks by a script, which may read no file. So the job has the steps of
the plan as JSON in a setting, and the script makes tasks of them: one, or one for each few frames.
Source: https://flamenco.blender.org/usage/job-types/, and the OpenAPI of the Manager (`SubmittedJob`).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from flowsculpt.api.frames import Plan
from flowsculpt.pipeline.plugins.farm.farm_steps import FarmStep, steps_of

JOB_TYPE = Path(__file__).with_name("flowsculpt.js")
"""The script of the job type; Flamenco calls the type as the file."""

PLATFORMS = {"win32": "windows", "darwin": "darwin"}
"""How Flamenco calls operating systems, by Python's names; all others are linux."""


def submitted_job(plan: Plan, plan_file: Path, root: Path, name: str, store: str | None) -> dict[str, Any]:
    """Return the body of `POST /api/v3/jobs` for a whole plan.

    plan_file, root  as workers see them
    store            the address of the remote store, if workers share one
    """
    return {
        "name": f"flowsculpt {name}",
        "type": JOB_TYPE.stem,
        "priority": 50,
        "submitter_platform": PLATFORMS.get(sys.platform, "linux"),
        "settings": {
            "plan": str(plan_file),
            "root": str(root),
            "store": store or "",
            "executable": "flowsculpt",
            "chunk_size": 0,
            "steps": json.dumps([_step(step) for step in steps_of(plan)]),
        },
        "metadata": {},
    }


def _step(step: FarmStep) -> dict[str, Any]:
    return {
        "name": f"{step.kind} {step.shot}".strip(),
        "tasks": [step.task] if step.frames else [job.name for job in step.jobs],
        "frames": list(step.frames),
        "chunk": step.chunk,
        "after": list(step.after),
    }
