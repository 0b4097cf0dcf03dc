"""The time that a run still takes, estimated from the frames that it has made."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from flowsculpt.pipeline.production.planning.estimate import TimeLeft
from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource

pytestmark = pytest.mark.quick

SHOT = "title: A\nframes: 1-90\nsubject: {solid: box, size: [2, 2, 2]}\nresample: off\n"

COSTS = {"simulate": 0.1, "render": 1.0, "finish": 0.5}
"""CPU seconds of a frame."""


class Run:
    """A run of one core that makes 90 frames, stage after stage in batches of 30, by a clock of its own."""

    def __init__(self, root: Path, load: float = 1.0) -> None:
        self.now, self.load = 100.0, load
        self.jobs = [self._job("simulate", 1, 91)]
        for first in (1, 31, 61):
            self.jobs += [self._job(stage, first, first + 30) for stage in ("render", "finish")]
        request = RenderRequest(ShotSource(SHOT, Path("/shots/A.yaml"), ()), "draft", "none", ())
        self.time_left = TimeLeft(Plan((request,), None, tuple(self.jobs)), root, lambda: self.now)
        self.shown: list[tuple[float, float]] = []

    @staticmethod
    def _job(stage: str, first: int, end: int) -> Job:
        return Job(f"{stage}_{first}", stage, (0,), tuple(range(first, end)))

    @property
    def length(self) -> float:
        """The wall time of the whole run."""
        return self.load * 90 * sum(COSTS.values())

    def go(self) -> None:
        """Make all frames; note after each when it was, and what time was said to be left."""
        for job in self.jobs:
            self.time_left.note({"event": "begin", "job": job.name, "stage": job.stage})
            for number in job.frames:
                self.now += self.load * COSTS[job.stage]
                made = {"found": False, "cpu": COSTS[job.stage], "seconds": self.load * COSTS[job.stage]}
                self.time_left.note({"event": "frame", "job": job.name, "frame": number, **made})
                share = self.time_left.share({})
                if share is not None:
                    self.shown.append((self.now - 100.0, self.time_left.seconds(share)))


@pytest.mark.parametrize("load", [0.2, 1.0, 20.0])
def test_the_time_left_is_right_whatever_else_the_machine_does(load: float, tmp_path: Path) -> None:
    run = Run(tmp_path, load)
    run.go()
    later = [(passed, left) for passed, left in run.shown if passed > 0.5 * run.length]
    assert len(later) > 10  # by then a batch was finished, and its cost is known
    for passed, left in later:
        assert left == pytest.approx(run.length - passed, abs=0.1 * run.length + 10.0)


def test_the_time_left_does_not_jump(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.go()
    ends = [passed + left for passed, left in run.shown]
    steps = [abs(after - before) for before, after in pairwise(ends)]
    assert max(steps) < 0.05 * run.length


def test_nothing_is_said_before_a_frame_is_rendered(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.go()
    first, _ = run.shown[0]
    assert first == pytest.approx(90 * COSTS["simulate"] + COSTS["render"])


def test_a_frame_that_is_reported_twice_counts_once(tmp_path: Path) -> None:
    run = Run(tmp_path)
    made = {"event": "frame", "job": "render_1", "frame": 1, "found": False, "cpu": 1.0}
    run.time_left.note(made)
    once = run.time_left.share({})
    run.time_left.note({**made, "found": True})
    assert run.time_left.share({}) == once


def test_parts_of_frames_count(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.time_left.note({"event": "frame", "job": "render_1", "frame": 1, "found": False, "cpu": 1.0})
    none, half = run.time_left.share({}), run.time_left.share({"render_1": 0.5})
    assert none is not None and half == pytest.approx(1.5 * none)
