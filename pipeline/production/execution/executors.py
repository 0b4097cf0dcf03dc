"""Snakemake's executors: an own one hands jobs to the pool of workers, and those of farms are extended.

The own one runs all other jobs, such as a target rule without a command, as Snakemake's local executor. Jobs
of farms run our Python, and avoid the hosts that are unfit for them.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

from snakemake.exceptions import SpawnedJobError
from snakemake.executors import local
from snakemake_interface_executor_plugins.registry import ExecutorPluginRegistry

from flowsculpt.pipeline.production.tasks.worker_pool import WorkerPool
from flowsculpt.render.base.python_process import python_command

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


UnfitHosts = Callable[[Any], set[str]]
"""Returns the hosts that are not to get a job of Snakemake."""


def extend_farm_executors(unfit_hosts: UnfitHosts) -> None:
    """Have the executors of all farms run jobs by our Python, and that of SLURM avoid unfit hosts."""
    for name, plugin in ExecutorPluginRegistry().plugins.items():
        if plugin.common_settings.non_local_exec:
            plugin.executor = _with_our_python(plugin.executor)
            if name == "slurm":
                plugin.executor = avoid_unfit_hosts(plugin.executor, unfit_hosts)


def _with_our_python(executor: Any) -> Any:
    """Return an executor class that quotes the Python of its jobs, and has it trust no folder of a show."""

    class FarmExecutor(executor):  # type: ignore[misc]  # Snakemake has no types
        def get_python_executable(self) -> str:
            python, ours = str(super().get_python_executable()), python_command("snakemake")[:2]
            return shlex.join(ours) if python == ours[0] else python

    return FarmExecutor


def avoid_unfit_hosts(executor: Any, unfit_hosts: UnfitHosts) -> Any:
    """Return an executor class of SLURM that gives no job to the hosts that are unfit for it."""

    class SlurmExecutor(executor):  # type: ignore[misc]
        def run_jobs(self, jobs: Sequence[Any]) -> None:
            for job in jobs:
                hosts = set() if job.is_group() else unfit_hosts(job)
                if hosts and _nodes_of_slurm() - hosts:  # it refuses jobs that no node may take
                    named = self.workflow.executor_settings.exclude_failed_nodes or ""
                    hosts.update(filter(None, map(str.strip, named.split(","))))
                    extra = f"{job.resources.get('slurm_extra') or ''} --exclude={','.join(sorted(hosts))}"
                    job.resources.slurm_extra = extra.strip()
            super().run_jobs(jobs)

    return SlurmExecutor


def _nodes_of_slurm() -> set[str]:
    """Return the names of the nodes that SLURM has."""
    done = subprocess.run(["sinfo", "--noheader", "--Node", "--format=%N"], capture_output=True, text=True)
    return set(done.stdout.split())
