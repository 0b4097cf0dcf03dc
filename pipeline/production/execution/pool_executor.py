"""The executor plug-in by which Snakemake hands jobs to the pool of workers, instead of starting shells.

All other jobs, such as a target rule without a command, run as with Snakemake's local executor.
"""

from __future__ import annotations

import shlex
import sys
from concurrent.futures import Future
from typing import Any

from snakemake.exceptions import SpawnedJobError
from snakemake.executors import local
from snakemake_interface_executor_plugins.registry import ExecutorPluginRegistry

from flowsculpt.pipeline.production.tasks.worker_pool import WorkerPool

NAME = "flowsculpt"

common_settings = local.common_settings


def register(pool: WorkerPool) -> str:
    """Make this module an executor plug-in of this process, with a pool; return its name."""
    Executor.worker_pool = pool
    ExecutorPluginRegistry().register_plugin(NAME, sys.modules[__name__])
    return NAME


class Executor(local.Executor):  # type: ignore[misc]  # Snakemake has no types
    """Has the jobs of a workflow done by workers."""

    worker_pool: WorkerPool

    def __post_init__(self) -> None:
        super().__post_init__()
        self.worker_pool.start()

    def run_single_job(self, job: Any) -> Future[None]:
        """Give a job to the pool; return a future with no result, or with an error where the job failed."""
        if "job" not in job.params.keys():  # noqa: SIM118  # they are Snakemake's, and no dict
            return super().run_single_job(job)
        self.workflow.async_run(job.prepare())
        result: Future[None] = Future()

        def end(code: int) -> None:
            if code:
                result.set_exception(SpawnedJobError())
            else:
                result.set_result(None)

        words = [*shlex.split(job.params.job), "--threads", str(job.threads), "--log", str(job.log[0])]
        self.worker_pool.submit(words, end)
        return result

    def cancel(self) -> None:
        """End all jobs, which keep what they have done."""
        self.worker_pool.close()
        super().cancel()
