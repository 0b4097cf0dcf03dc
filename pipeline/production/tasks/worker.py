"""Do one job, and report what it raises."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from importlib import import_module

from pipeline.errors import FlowsculptError, FrameError
from pipeline.production.request.variants import ON_GPU
from pipeline.production.stages import STAGES
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.memory_guard import RESTART_WORKER, RestartWorker
from pipeline.production.tasks.supervisor import fall_back_to_other_variant
from render.mitsuba.engine import available_cores


def work(context: Context) -> int:
    """Do one job in this process; return 0 if all went well, 1 if the event log says what failed.

    Return RESTART_WORKER if a fresh process is to render the rest.
    """
    job = context.job
    _limit_kernels(job.threads)
    try:
        well = task_of(job.stage)(context)
    except RestartWorker as restart:
        context.renewed(restart.held, restart.limit)
        return RESTART_WORKER
    except FlowsculptError as error:
        context.fail(error)
        well = False
    except Exception as error:
        traceback.print_exc()
        on_gpu = job.stage == "render" and context.request.variant == ON_GPU
        if on_gpu and fall_back_to_other_variant(context, f"failed ({str(error).partition(chr(10))[0]})"):
            return 1  # its memory may be too small, its driver too old: nothing that another frame would mend
        context.fail(FrameError(f"{job.name}: {type(error).__name__}: {error}; this is a bug in flowsculpt"))
        well = False
    context.log.write("end", stage=job.stage)
    return 0 if well else 1


def task_of(stage: str) -> Callable[[Context], bool]:
    """Return the function that does the jobs of a stage; it returns True if all went well."""
    module = import_module(f"pipeline.production.tasks.{STAGES[stage].module}")
    task: Callable[[Context], bool] = getattr(module, stage)
    return task


def _limit_kernels(threads: int) -> None:
    """A kernel on more threads than a job was given waits for them, busily, while others have the cores.

    numba looks at the environment when it is first imported, which many jobs never do.
    """
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = str(min(threads, available_cores()))
        return
    import numba

    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
