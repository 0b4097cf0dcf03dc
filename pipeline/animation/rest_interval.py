"""The frames that share a surface at rest, and what carries points from it to now."""

from __future__ import annotations

from functools import partial

from pipeline.flow import Flow
from pipeline.flow.flow_map import FlowMap, FrameStep
from pipeline.resample import Exact
from pipeline.shot import Motion, Resampling


def step_into(motion: Motion, flow: Flow, frame: int) -> FrameStep:
    """What moves the surface into `frame`."""
    return FrameStep(motion.bounded(flow, frame), *motion.step(frame), frame)


class Epoch:
    """The frames that share a surface at rest: that of the first frame, or every `rest_interval`-th after it.

    Carrying would cost ever more as a film goes on; a new surface at rest bounds it. Which epoch it is
    follows from the number of the frame, so that a run that goes on from any frame knows.
    """

    def __init__(self, motion: Motion, resampling: Resampling, flow: Flow, number: int) -> None:
        first, length = motion.frames.first, resampling.rest_interval
        self.rest = first + (number - first) // length * length
        self.over = self.rest + length
        self.history = FlowMap()
        for frame in range(self.rest + 1, number + 1):
            self.history.add(step_into(motion, flow, frame))
        project = motion.subject.project if self.rest == first else None
        self.placement = Exact(self.history.carry, project, tags_creases=False)
        self._next = partial(Epoch, motion, resampling, flow, self.over)

    def next(self) -> Epoch:
        """The one that begins when this is over."""
        return self._next()
