"""The time that a run still takes, by the frames that it has made.

Work is counted in CPU seconds. A frame that is not made yet counts as those of its stage and shot took in
this run. Until there are any, it counts as in earlier runs, as those of other shots in this one, or as
typical. The time left is to the time so far as the work left is to the work done: other programs are taken
to leave as much of the machine as they did.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.production.planning.estimate import MeanTimings, shot_and_quality
from pipeline.production.planning.plan import Job, Plan
from pipeline.production.store.event_log import Event

SMOOTHING = 8.0
"""Seconds in which the end that is shown comes closer by two thirds to the one that is estimated."""

TYPICAL = {"simulate": 0.08, "smooth_normals": 0.02, "frame_camera": 0.005}
"""CPU seconds of a frame of the shots of `shots/`, for stages that make no pictures."""

TYPICAL_OF_PIXELS = {"render": 7e-6, "finish": 5e-6, "assemble": 2e-7, "film": 2e-7}
"""CPU seconds of a pixel of theirs at draft; stills take TYPICAL_OF_STILLS."""

TYPICAL_OF_STILLS = 1e-6


@dataclass(eq=False)
class _Work:
    """The frames that a run makes of one stage of one shot and quality.

    guess    CPU seconds of a frame, by earlier runs; None where these made none
    typical  CPU seconds of a typical one
    total    how many are to be made
    settled  those that are made or failed
    made     how many were computed in this run
    cpu      their CPU seconds
    """

    stage: str
    guess: float | None
    typical: float
    total: int = 0
    settled: set[int] = field(default_factory=set)
    made: int = 0
    cpu: float = 0.0


class TimeLeft:
    """Estimates the time that a run of a plan still takes.

    root   where earlier runs left their timings
    clock  returns seconds
    """

    def __init__(self, plan: Plan, root: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._jobs: dict[str, _Work] = {}
        self._began: float | None = None
        self._end: float | None = None
        self._looked = 0.0
        timings, works = MeanTimings(root), dict[tuple[str, str, str], _Work]()
        for job in plan.jobs:
            place = job.stage, *shot_and_quality(plan, job)
            if place not in works:
                works[place] = _new_work(plan, job, timings)
            works[place].total += len(job.frames)
            self._jobs[job.name] = works[place]
        self._works = list(works.values())
        stages = [work.stage for work in self._works]
        self._decisive = "render" if "render" in stages else next(iter(stages), "")

    def note(self, event: Event) -> None:
        """Take an event of the run into account."""
        if event["event"] == "begin" and self._began is None:
            self._began = self._clock()
        work, frame = self._jobs.get(event["job"]), event.get("frame")
        if work is None or frame is None or event["event"] not in ("frame", "fail"):
            return
        work.settled.add(frame)
        if event["event"] == "frame" and not event["found"] and "cpu" in event:
            work.made += 1
            work.cpu += float(event["cpu"])

    def share(self, under_way: Mapping[str, float]) -> float | None:
        """Return the share of the work that is done, above 0; None before the first frame is rendered.

        under_way  by job, how many frames' worth it has done of frames that are not finished
        """
        if not any(work.made for work in self._works if work.stage == self._decisive):
            return None
        parts: defaultdict[_Work, float] = defaultdict(float)
        for name, part in under_way.items():
            if name in self._jobs:
                parts[self._jobs[name]] += part
        done = whole = 0.0
        for work in self._works:
            cost = self._cost(work)
            done += cost * min(len(work.settled) + parts[work], work.total)
            whole += cost * work.total
        return done / whole if done else None

    def seconds(self, share: float) -> float:
        """Return the time left once a share of the work is done, smoothed over the last seconds."""
        now = self._clock()
        began = now if self._began is None else self._began
        end = now + (now - began) * (1.0 - share) / share
        if self._end is None:
            self._end = end
        self._end += (end - self._end) * (1.0 - math.exp(-(now - self._looked) / SMOOTHING))
        self._looked = now
        return max(0.0, self._end - now)

    def _cost(self, work: _Work) -> float:
        """Return the CPU seconds that a frame takes."""
        if work.made:
            return work.cpu / work.made
        if work.guess is not None:
            return work.guess
        alike = [other for other in self._works if other.stage == work.stage and other.made]
        if alike:
            return sum(other.cpu for other in alike) / sum(other.made for other in alike)
        return work.typical


def _new_work(plan: Plan, job: Job, timings: MeanTimings) -> _Work:
    shot, quality = shot_and_quality(plan, job)
    width, height = plan.requests[job.requests[0]].quality.rendered_size
    pixels, stage = width * height, job.stage
    guess = timings.seconds(stage, shot, quality, pixels)
    typical = TYPICAL.get(stage) or pixels * TYPICAL_OF_PIXELS.get(stage, TYPICAL_OF_STILLS)
    return _Work(stage, None if guess is None else guess.seconds, typical)
