"""Snakemake, in a process of its own: the Snakefile, a frozen plan, this many cores.

A process of its own can be ended with all of its jobs, prints where it likes, and leaves our signal handlers
alone. `python -m pipeline.production.scheduler PLAN CORES`, in the root, is that process.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil

from pipeline.errors import MachineError
from pipeline.production.disk import disk_faults
from pipeline.production.layout import LOGS

PATIENCE = 5.0
"""Seconds that processes have to end before they are killed."""


def snakefile() -> Path:
    """The checkout's Snakefile, or the one shipped in the wheel."""
    here = Path(__file__)
    for place in (here.parents[2] / "Snakefile", here.with_name("Snakefile")):
        if place.is_file():
            return place
    raise MachineError("no Snakefile beside the package; install flowsculpt again")


def log_of(plan: Path) -> Path:
    """What Snakemake prints while it runs a plan, relative to the root."""
    return LOGS / plan.stem / "snakemake.log"


def execute(plan: Path, root: Path, cores: int) -> bool:
    """Run a frozen plan (relative to `root`); whether every job ended well.

    An interrupt ends all jobs before it is passed on.
    """
    log = root / log_of(plan)
    with disk_faults(log):
        log.parent.mkdir(parents=True, exist_ok=True)
        output = log.open("w")
    command = [sys.executable, "-m", "pipeline.production.scheduler", plan.as_posix(), str(cores)]
    with (
        output,
        subprocess.Popen(
            command, cwd=root, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        ) as process,
    ):
        try:
            return process.wait() == 0
        except BaseException:
            end_family(process.pid)
            raise


def end_family(pid: int) -> None:
    """End a process, if it is still there, and all that it started: asked first, then killed."""
    with contextlib.suppress(psutil.NoSuchProcess):
        parent = psutil.Process(pid)
        family = [*parent.children(recursive=True), parent]
        for member in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                member.terminate()
        _, stubborn = psutil.wait_procs(family, timeout=PATIENCE)
        for member in stubborn:
            with contextlib.suppress(psutil.NoSuchProcess):
                member.kill()


def _run_snakemake(plan: str, cores: int) -> bool:
    """The lock is ours, not Snakemake's, whose lock outlives a killed process. Times decide nothing: keys
    in the plan do, and a plan holds only jobs that are needed."""
    from snakemake.api import SnakemakeApi
    from snakemake.exceptions import WorkflowError
    from snakemake.scheduling.greedy import SchedulerSettings as Greedy
    from snakemake.settings import types as settings
    from snakemake.settings.enums import RerunTrigger

    output = settings.OutputSettings(show_failed_logs=True, enable_file_logging=False)
    try:
        with SnakemakeApi(output) as api:
            workflow = api.workflow(
                resource_settings=settings.ResourceSettings(cores=cores),
                config_settings=settings.ConfigSettings(config={"plan": plan}),
                snakefile=snakefile(),
            )
            dag = workflow.dag(
                settings.DAGSettings(
                    force_incomplete=True,
                    rerun_triggers=frozenset({RerunTrigger.PARAMS}),
                    max_checksum_file_size=0,
                )
            )
            dag.execute_workflow(
                execution_settings=settings.ExecutionSettings(keep_going=True, lock=False, latency_wait=5),
                scheduling_settings=settings.SchedulingSettings(scheduler="greedy"),
                scheduler_settings=Greedy(),
                greedy_scheduler_settings=Greedy(),
            )
    except WorkflowError as error:
        print(error, file=sys.stderr)
        return False
    return True


def _leave_with(parent: int) -> None:
    """End this process and its jobs once the process that started it is gone, however it went."""
    while os.getppid() == parent:
        time.sleep(0.5)
    end_family(os.getpid())


def main(plan: str, cores: str) -> int:
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
    return 0 if _run_snakemake(plan, int(cores)) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
