"""Doing one job: what each task is called, and what becomes of what it raises."""

from __future__ import annotations

import traceback
from importlib import import_module
from pathlib import Path

import numba

from pipeline.errors import FrameError
from pipeline.production.plan import Plan
from pipeline.production.tasks.context import REPORTED, Context

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


def work(root: Path, plan: Plan, job_name: str) -> int:
    """Do one job in this process; 0 where all went well, 1 where the event log says what failed."""
    context = Context.of(root, plan, job_name)
    job = context.job
    context.log.write("begin", stage=job.task)
    # A kernel on more threads than the job was given waits for them, busily, while other jobs have the cores.
    numba.set_num_threads(min(job.threads, numba.config.NUMBA_NUM_THREADS))
    try:
        task = getattr(import_module(f"pipeline.production.tasks.{PLACES[job.task]}"), job.task)
        well = task(context)
    except REPORTED as error:
        context.fail(error)
        well = False
    except Exception as error:
        traceback.print_exc()
        context.fail(FrameError(f"{job_name}: {type(error).__name__}: {error}; this is a bug in flowsculpt"))
        well = False
    context.log.write("end", stage=job.task)
    return 0 if well else 1
