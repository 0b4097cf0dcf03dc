"""The process of one job. Rendering happens in a child: a renderer that crashes takes only itself along."""

from __future__ import annotations

import signal
import subprocess
import sys
import traceback
from importlib import import_module
from pathlib import Path

import numba

from pipeline.errors import FrameError
from pipeline.production.events import EventLog
from pipeline.production.layout import EVENTS
from pipeline.production.plan import Plan
from pipeline.production.tasks.context import REPORTED, Context
from pipeline.production.variants import avoid

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

CRASHES = {signal.SIGABRT, signal.SIGSEGV, signal.SIGILL, signal.SIGBUS, signal.SIGFPE}


def main(plan_path: str, job_name: str, *, child: bool = False) -> int:
    """Do one job; 0 where all of it went well, 1 where something failed and the event log says what."""
    root = Path.cwd()
    plan = Plan.thaw(root / plan_path)
    job = plan.job(job_name)
    context = Context(root, plan, job, EventLog(root / EVENTS / f"{plan.name}.jsonl", job_name))
    if job.task == "render" and not child:
        return _supervise(context, plan_path)
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


def _supervise(context: Context, plan_path: str) -> int:
    """Run a rendering job in a child; where it crashes, have its shot rendered by another variant."""
    command = [sys.executable, "-m", "pipeline.production.tasks", plan_path, context.job.name, "--child"]
    code = subprocess.run(command, stdin=subprocess.DEVNULL, check=False).returncode
    if code >= 0 or -code in (signal.SIGINT, signal.SIGTERM):
        return abs(code)
    name = signal.Signals(-code).name
    take = context.take
    if -code in CRASHES:
        reason = f"{take.variant} crashed ({name}) while rendering {context.subject}"
        if avoid(context.root, take.name, take.variant, reason):
            context.log.write("healed", message=f"{reason}; the shot is rendered without it from the start")
            return 1
    context.fail(FrameError(f"{context.subject}: the renderer was ended by {name}; is there memory enough?"))
    return 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], sys.argv[2], child="--child" in sys.argv[3:]))
    except KeyboardInterrupt:
        sys.exit(130)
