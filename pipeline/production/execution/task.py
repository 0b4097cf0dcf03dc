"""Tasks of a render manager: stages of a frozen plan, or some of their frames.

A manager calls them in the order of the stages, on workers that see the root, as often and as many side by
side as it likes. They take no lock on the shot: each finds in the store what others have made.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import MissingInputError, UsageError, suggestion
from pipeline.frames import FrameRange
from pipeline.production.planning.plan import Plan


def do(root: Path, plan_file: Path, tasks: Sequence[str]) -> int:
    """Do tasks of a plan in a root, one after the other until one fails; return 0, or 1 where one failed.

    tasks  names of stages, `simulate`, or of frames of a stage, `render:1-8`

    Raises MissingInputError where the root or the plan is not there, UsageError for a file that is no plan
    and for a task that is not in it.
    """
    from pipeline.production.tasks.worker import main

    plan_file = plan_file.absolute()
    jobs = list(_jobs(_plan(plan_file), plan_file, tasks))
    try:
        os.chdir(root)
    except OSError as error:
        raise MissingInputError(f"{root}: this worker does not see the root ({error.strerror})") from None
    return next((code for job in jobs if (code := main(str(plan_file), job, insist=True))), 0)


def _plan(file: Path) -> Plan:
    try:
        return Plan.thaw(file)
    except OSError as error:
        raise MissingInputError(
            f"{file}: this worker does not see the plan ({error.strerror}); flowsculpt export plan writes one"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{file}: it is no plan; flowsculpt export plan SHOT writes one") from None


def _jobs(plan: Plan, file: Path, tasks: Sequence[str]) -> Iterator[str]:
    """Yield the names of the plan's jobs that tasks stand for."""
    stages = dict.fromkeys(job.stage for job in plan.jobs)
    for task in tasks:
        stage, _, frames = task.partition(":")
        if any(job.name == task for job in plan.jobs):
            yield task
            continue
        if stage not in stages:
            raise UsageError(f"{task}: {file.name} has no stage {stage!r}. {suggestion(stage, stages)}")
        if not frames:
            yield from (job.name for job in plan.jobs if job.stage == stage)
            continue
        planned = {number for job in plan.jobs if job.stage == stage for number in job.frames}
        others = [number for number in FrameRange.parse(frames).numbers if number not in planned]
        if others:
            known = FrameRange.of(sorted(planned))
            raise UsageError(
                f"{task}: frames {FrameRange.of(others)} are not in {file.name}, which has {known}; "
                "export the plan again for more"
            )
        yield task
