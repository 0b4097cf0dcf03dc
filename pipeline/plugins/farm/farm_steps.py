"""The steps of a plan on a farm: for each shot its surfaces, its renders, what plug-ins make of them, its
finished frames, its movie.

Open Job Description and Flamenco take them: each has jobs that other steps may have to wait for, also those
of another shot that has the same meshes. The first tasks of a shot are one step, for only its simulation is
worth a place in a queue.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from flowsculpt.api.frames import Job, PipelineStage, Plan
from flowsculpt.pipeline.plugins.farm.task_runner import BY_FRAMES, OF_PLUGINS

STEPS = {
    "Surfaces": ("simulate", "smooth_normals", "frame_camera"),
    "Render": ("render",),
    **{name: (name,) for name in OF_PLUGINS},
    "Finish": ("finish",),
    "Assemble": ("assemble",),
    "Film": ("film",),
}
"""The stages of each step, in the order in which a task does them."""


@dataclass(frozen=True)
class FarmStep:
    """One step of a plan: jobs for a shot, or for the film, and the places of the steps that it waits for."""

    plan: Plan
    kind: str
    shot: str
    jobs: tuple[Job, ...]
    after: tuple[int, ...] = ()

    @property
    def frames(self) -> tuple[int, ...]:
        """The frames that its tasks share out, ascending; none where one task does it all."""
        numbers = {number for job in self.jobs for number in job.frames}
        return tuple(sorted(numbers)) if STEPS[self.kind][0] in BY_FRAMES else ()

    @property
    def task(self) -> str:
        """The task that makes its frames, without these, as `flowsculpt task` takes it."""
        return f"{self.shot}/{STEPS[self.kind][0]}"

    @property
    def chunk(self) -> int:
        """The frames of a task, by the plan; 0 where one task does all."""
        return max(len(job.frames) for job in self.jobs) if self.frames else 0

    @property
    def chunk_seconds(self) -> int:
        """The time, seconds, that such a task is expected to take; 0 where one task does all."""
        return math.ceil(max(job.seconds for job in self.jobs)) if self.frames else 0

    @property
    def memory_mib(self) -> int:
        """The memory of a task, MiB."""
        return max(self.plan.memory_mib(job) for job in self.jobs)

    @property
    def gpus(self) -> int:
        """The GPUs of a task."""
        return max(self.plan.gpus(job) or 0 for job in self.jobs)

    def minutes(self, threads: int) -> int:
        """Return the time limit of a task on so many threads."""
        if self.frames:
            return max(self.plan.minutes(job, threads) or 0 for job in self.jobs)
        return sum(self.plan.minutes(job, threads) or 0 for job in self.jobs)


def steps_of(plan: Plan) -> list[FarmStep]:
    """Return the steps of a plan, each after those that it waits for."""
    shots = list(dict.fromkeys(request.name for request in plan.requests))
    kinds = [(shot, kind) for kind in STEPS if kind != "Film" for shot in shots]
    steps = [FarmStep(plan, kind, shot, _jobs(plan, shot, kind)) for shot, kind in kinds]
    film = tuple(job for job in plan.jobs if job.stage == "film")
    steps = [step for step in (*steps, FarmStep(plan, "Film", "", film)) if step.jobs]
    places = {job.name: place for place, step in enumerate(steps) for job in step.jobs}
    return [replace(step, after=_waits_for(step, place, places)) for place, step in enumerate(steps)]


def _jobs(plan: Plan, shot: str, kind: str) -> tuple[Job, ...]:
    """Return the jobs of a step: what several shots need is made for the first."""
    jobs = [job for job in plan.jobs if plan.requests[job.requests[0]].name == shot]
    return tuple(job for stage in STEPS[kind] for job in jobs if job.stage == stage)


def _waits_for(step: FarmStep, own: int, places: dict[str, int]) -> tuple[int, ...]:
    """Return the places of the steps whose jobs make what a step reads; `places` are by names of jobs."""
    read = {
        places[other.name]
        for job in step.jobs
        for stage in PipelineStage.all()[job.stage].reads
        for place in job.requests
        for other in step.plan.jobs_of(place, stage)
    }
    return tuple(sorted(place for place in read if place < own))
