"""`python -m pipeline.production.tasks PLAN JOB`: the process of one job.

Rendering happens in a child: a renderer that crashes takes only itself along. What a job needs is imported
by the process that does it alone.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

from pipeline.production.plan import Plan

CRASHES = {signal.SIGABRT, signal.SIGSEGV, signal.SIGILL, signal.SIGBUS, signal.SIGFPE}


def main(plan_path: str, job_name: str, *, child: bool = False) -> int:
    """Do one job; 0 where all of it went well, 1 where something failed and the event log says what."""
    root = Path.cwd()
    plan = Plan.thaw(root / plan_path)
    if plan.job(job_name).task != "render" or child:
        return int(import_module("pipeline.production.tasks.work").work(root, plan, job_name))
    command = [sys.executable, "-m", "pipeline.production.tasks", plan_path, job_name, "--child"]
    code = subprocess.run(command, stdin=subprocess.DEVNULL, check=False).returncode
    if code >= 0 or -code in (signal.SIGINT, signal.SIGTERM):
        return abs(code)
    return _ended_by(signal.Signals(-code), root, plan, job_name)


def _ended_by(ending: signal.Signals, root: Path, plan: Plan, job_name: str) -> int:
    """Tell how a child ended; where it crashed, have its shot rendered by another variant."""
    from pipeline.errors import FrameError
    from pipeline.production.tasks.context import Context
    from pipeline.production.variants import avoid

    context = Context.of(root, plan, job_name)
    take = context.take
    if ending in CRASHES:
        reason = f"{take.variant} crashed ({ending.name}) while rendering {context.subject}"
        if avoid(root, take.name, take.variant, reason):
            context.log.write("healed", message=f"{reason}; the shot is rendered without it from the start")
            return 1
    context.fail(
        FrameError(f"{context.subject}: the renderer was ended by {ending.name}; is there memory enough?")
    )
    return 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], sys.argv[2], child="--child" in sys.argv[3:]))
    except KeyboardInterrupt:
        sys.exit(130)
