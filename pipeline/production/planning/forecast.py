"""The forecast of a plan: the frames that a run makes, as far as known before cameras are framed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from pipeline.production.planning.frame_states import KnownPictures
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import FORMS
from pipeline.production.store.store import Store

_KINDS = {"render": "raw", "finish": "frame", **{form: form for form in FORMS}}
"""Kinds of files by the stage that makes them, of pictures one by one."""


@dataclass(frozen=True)
class Forecast:
    """A plan without the frames that its jobs will find.

    plan      with the jobs that make something, or perhaps do
    unframed  frames by stage that are made only if their camera moves
    """

    plan: Plan
    unframed: Mapping[str, tuple[int, ...]]

    @classmethod
    def of(cls, plan: Plan, store: Store) -> Forecast:
        """Return the forecast of a plan. Frames that are made again by force are all made."""
        known: dict[int, KnownPictures] = {}
        unframed: defaultdict[str, list[int]] = defaultdict(list)
        jobs = []
        for job in plan.jobs:
            place = job.requests[0]
            if job.stage in _KINDS and job.stage not in plan.force:
                if place not in known:
                    request = plan.requests[place]
                    known[place] = KnownPictures(request, store, request.requested)
                if not known[place].is_framed:
                    held = {n: known[place].holds(_KINDS[job.stage], n) for n in job.frames}
                    unframed[job.stage] += [n for n, is_held in held.items() if is_held is None]
                    job = replace(job, frames=tuple(n for n, is_held in held.items() if not is_held))
            if job.frames:
                jobs.append(job)
        return cls(replace(plan, jobs=tuple(jobs)), {stage: tuple(n) for stage, n in unframed.items() if n})

    @cached_property
    def certain(self) -> Mapping[str, int]:
        """The number of frames by stage that are made for certain."""
        counts = self.plan.frame_counts()
        return {stage: n for stage in counts if (n := counts[stage] - len(self.unframed.get(stage, ())))}
