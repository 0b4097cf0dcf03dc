"""Doing one job: what each task is called, and what becomes of what it raises."""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module

from pipeline.errors import FrameError
from pipeline.production.request.variants import ON_GPU
from pipeline.production.tasks.job import REPORTED, Context
from pipeline.production.tasks.memory_guard import RENEWED, WornOutError
from pipeline.production.tasks.supervisor import fall_over
from render.mitsuba.engine import available_cores

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


def work(context: Context) -> int:
    """Do one job in this process; 0 where all went well, 1 where the event log says what failed, and RENEWED
    where a fresh process is to render the rest."""
    job = context.job
    _limit_kernels(job.threads)
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
        context.fail(FrameError(f"{job.name}: {type(error).__name__}: {error}; this is a bug in flowsculpt"))
        well = False
    context.log.write("end", stage=job.task)
    return 0 if well else 1


def _limit_kernels(threads: int) -> None:
    """A kernel on more threads than a job was given waits for them, busily, while others have the cores.

    numba looks at the environment when it is first imported, which many jobs never do.
    """
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = str(min(threads, available_cores()))
        return
    import numba

    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
