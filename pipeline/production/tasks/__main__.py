"""The process of one job. Rendering happens in a child: a renderer that crashes takes only itself along."""

from __future__ import annotations

import sys
import traceback
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numba

from pipeline.errors import FrameError
from pipeline.production.events import EventLog
from pipeline.production.layout import EVENTS
from pipeline.production.plan import Plan
from pipeline.production.tasks.context import REPORTED, Context
from pipeline.production.tasks.supervise import Supervisor, fall_over, renderer
from pipeline.production.tasks.wear import RENEWED, WornOutError
from pipeline.production.variants import ON_GPU

PLACES = {
    "simulate": "meshes",
    "smooth_normals": "meshes",
    "frame_camera": "meshes",
    "render": "pictures",
    "finish": "finishing",
    "assemble": "movies",
    "film": "movies",
    "png": "stills",
    "png16": "stills",
    "jpeg": "stills",
}
"""The module that holds each task: a task imports only what it needs."""


def main(plan_path: str, job_name: str, settled: int | None = None) -> int:
    """Do one job; 0 where all of it went well, 1 where something failed and the event log says what.

    settled  of a process that renders: how many of the job's frames others before it have made, or failed at;
             None lets rendering happen in such processes. One that has grown large returns RENEWED.
    """
    root = Path.cwd()
    plan = Plan.thaw(root / plan_path)
    job = plan.job(job_name)
    context = Context(root, plan, job, EventLog(root / EVENTS / f"{plan.name}.jsonl", job_name))
    if settled is not None:
        context = replace(context, job=replace(job, frames=job.frames[settled:]))
    elif job.task == "render":
        return Supervisor(context, renderer(plan_path, job_name)).run()
    context.log.write("begin", stage=job.task)
    # A kernel on more threads than the job was given waits for them, busily, while other jobs have the cores.
    numba.set_num_threads(min(job.threads, numba.config.NUMBA_NUM_THREADS))
    try:
        task = getattr(import_module(f"pipeline.production.tasks.{PLACES[job.task]}"), job.task)
        well = task(context)
    except WornOutError as worn:
        context.renewed(worn.held, worn.most)
        return RENEWED
    except REPORTED as error:
        context.fail(error)
        well = False
    except Exception as error:
        traceback.print_exc()
        on_gpu = job.task == "render" and context.take.variant == ON_GPU
        if on_gpu and fall_over(context, f"failed ({str(error).partition(chr(10))[0]})"):
            return 1  # its memory may be too small, its driver too old: nothing that another frame would mend
        context.fail(FrameError(f"{job_name}: {type(error).__name__}: {error}; this is a bug in flowsculpt"))
        well = False
    context.log.write("end", stage=job.task)
    return 0 if well else 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], sys.argv[2], *(int(n) for n in sys.argv[4:5])))
    except KeyboardInterrupt:
        sys.exit(130)
