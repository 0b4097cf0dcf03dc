"""Memory, time, cores and GPUs that jobs request of a farm: by Snakemake, Open Job Description or Kubernetes.

Renders request what earlier frames of their shot and quality took; other jobs, and renders before there are
any, the defaults of `timings`.
"""

from __future__ import annotations

from pipeline.production.planning.plan import Job, Plan
from pipeline.production.planning.timings import LEAST_MIB, UNMEASURED_MIB, UNMEASURED_MINUTES
from pipeline.production.request.variants import ON_GPU


def memory_mib(plan: Plan, job: Job) -> int:
    """Return the memory of a job, MiB."""
    measured = plan.measured.get(job.requests[0])
    if job.stage == "render" and measured:
        return measured.memory_mib
    return UNMEASURED_MIB if plan.farm else LEAST_MIB


def minutes(plan: Plan, job: Job, threads: int, frames: int | None = None) -> int | None:
    """Return the time limit of a job on so many threads; None on this machine, where it has none.

    frames  how many it renders, by default all of its own
    """
    measured = plan.measured.get(job.requests[0])
    if job.stage == "render" and measured:
        return measured.minutes(len(job.frames) if frames is None else frames, threads)
    return UNMEASURED_MINUTES if plan.farm else None


def gpus(plan: Plan, job: Job) -> int | None:
    """Return 1 for a job of a farm that renders with CUDA, else None."""
    on_gpu = job.stage == "render" and plan.requests[job.requests[0]].variant == ON_GPU
    return 1 if plan.farm and on_gpu else None
