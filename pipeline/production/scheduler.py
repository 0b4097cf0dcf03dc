"""Snakemake, driven through its API: the Snakefile, a frozen plan, this many cores."""

from __future__ import annotations

import contextlib
import logging
import signal
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from types import FrameType

from pipeline.errors import MachineError
from pipeline.production.layout import LOGS

Watcher = AbstractContextManager[object]


def snakefile() -> Path:
    """The checkout's Snakefile, or the one shipped in the wheel."""
    here = Path(__file__)
    for place in (here.parents[2] / "Snakefile", here.with_name("Snakefile")):
        if place.is_file():
            return place
    raise MachineError("no Snakefile beside the package; install flowsculpt again")


def execute(plan: Path, root: Path, cores: int) -> bool:
    """Run a frozen plan (relative to `root`); whether every job ended well. Raises KeyboardInterrupt.

    The lock is ours, not Snakemake's, whose lock outlives a killed process. Times decide nothing: keys in
    the plan do, and a plan holds only jobs that are needed.
    """
    from snakemake.api import SnakemakeApi
    from snakemake.exceptions import WorkflowError
    from snakemake.scheduling.greedy import SchedulerSettings as Greedy
    from snakemake.settings import types as settings
    from snakemake.settings.enums import Quietness, RerunTrigger

    output = settings.OutputSettings(
        quiet=frozenset({Quietness.ALL}), show_failed_logs=False, enable_file_logging=False
    )
    try:
        with (
            _told_to_a_file(root / LOGS / plan.stem / "snakemake.log"),
            _interruptible(),
            SnakemakeApi(output) as api,
        ):
            workflow = api.workflow(
                resource_settings=settings.ResourceSettings(cores=cores),
                config_settings=settings.ConfigSettings(config={"plan": plan.as_posix()}),
                snakefile=snakefile(),
                workdir=root,
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
    except WorkflowError:
        return False  # what went wrong stands in the event log, job by job
    return True


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Snakemake ends its jobs on an interrupt and then speaks of a failure; make it an interrupt again."""
    interrupted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        signal.default_int_handler(number, frame)

    usual = signal.signal(signal.SIGINT, note)
    try:
        yield
    except Exception:
        if not interrupted:
            raise
    finally:
        signal.signal(signal.SIGINT, usual)
    if interrupted:
        raise KeyboardInterrupt


@contextlib.contextmanager
def _told_to_a_file(path: Path) -> Iterator[None]:
    """Keep what Snakemake prints away from the terminal, in a file that a curious person can read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    logger = logging.getLogger("snakemake")
    with path.open("a") as file, contextlib.redirect_stderr(file), contextlib.redirect_stdout(file):
        try:
            yield
        finally:
            for handler in list(logger.handlers):
                logger.removeHandler(handler)
