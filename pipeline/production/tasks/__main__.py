"""`python -m pipeline.production.tasks PLAN JOB [--child SETTLED]`: the process of one job.

Rendering happens in children: a renderer that crashes takes only itself along. What a job needs is imported
by the process that does it alone, so that who watches is there at once.
"""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from pipeline.production.planning.plan import Plan
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.supervisor import Supervisor, renderer


def main(plan_path: str, job_name: str, settled: int | None = None, insist: bool = False) -> int:
    """Do one job; 0 where all of it went well, 1 where something failed and the event log says what.

    settled  of a process that renders: how many of the job's frames others before it have made, or failed at;
             None lets rendering happen in such processes. One that has grown large returns `wear.RENEWED`.
    insist   do it again though an earlier attempt has said why it failed
    """
    root = Path.cwd()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what a farm sends first
    context = Context.of(root, Plan.thaw(root / plan_path), job_name)
    context.begin()
    if settled is None:
        if not insist and context.failed_for_good():
            return 1
        context.bring_inputs_to_now()
    if settled is not None:
        context = replace(context, job=replace(context.job, frames=context.job.frames[settled:]))
    elif context.job.task == "render":
        return Supervisor(context, renderer(plan_path, job_name)).run()
    return int(import_module("pipeline.production.tasks.worker").work(context))


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], sys.argv[2], next(map(int, sys.argv[4:5]), None)))
    except KeyboardInterrupt:
        sys.exit(130)
