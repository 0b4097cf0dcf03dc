"""A shot made by the production's own jobs, in this process, so that they can be measured."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numba

from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.planning.planner import Planner
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import Folders
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of
from flowsculpt.render.mitsuba.engine import Engine

NAME, PLAN = "T010_sitting", "sitting"


@dataclass(frozen=True)
class Sitting:
    """The jobs of a shot at a quality, none of them done yet.

    root  the folder that everything is written to
    """

    root: Path
    plan: Plan

    @classmethod
    def of(
        cls, root: Path, text: str, quality: str, engine: Engine, cores: int, frames: Sequence[int] = ()
    ) -> Sitting:
        """Plan the jobs of a shot.

        text    of the shot file
        frames  the requested frames; by default all, and their movie
        """
        path = root / "shots" / f"{NAME}.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(text)
        request = RenderRequest(ShotSource(text, path).with_inputs(), quality, engine.variant, tuple(frames))
        request = request if frames else request.whole()
        planner = Planner(Store(root), cores, cores)
        planner.pictures(request)
        planner.movie(request)
        plan = replace(planner.plan(), name=PLAN)
        plan.freeze(root)
        return cls(root, plan)

    def statistics(self, quality: str, number: int) -> dict[str, float]:
        """Return the seconds of a picture by activity, as the production records them."""
        folders = Folders.of_shot(NAME)
        told = json.loads((self.root / folders.numbered("statistics", quality, (number,))[0]).read_text())
        return {**told["seconds"], "vertices": told["vertices"]}

    def jobs(self, task: str) -> Iterator[Job]:
        return (job for job in self.plan.jobs if job.stage == task)

    def merged(self, task: str) -> Job:
        """Return all jobs of a task as one job of one process."""
        first, *others = self.jobs(task)
        return replace(first, frames=first.frames + tuple(n for job in others for n in job.frames))

    def do(self, job: Job, log: EventLog | None = None) -> None:
        """Run a job. Raises RuntimeError if a frame fails."""
        numba.set_num_threads(min(job.threads, numba.config.NUMBA_NUM_THREADS))
        log = log or EventLog(self.root / "events.jsonl", job.name)
        if not task_of(job.stage)(Context(self.root, self.plan, job, log)):
            raise RuntimeError(f"{job.name} failed: see above")

    def do_all(self, tasks: Sequence[str]) -> None:
        for task in tasks:
            for job in self.jobs(task):
                self.do(job)
