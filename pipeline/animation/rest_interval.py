"""RestInterval: the frames that share a surface at rest, and the flow from it to the present."""

from __future__ import annotations

from functools import partial

from pipeline.flow import Flow
from pipeline.flow.flow_map import FlowMap, FrameStep
from pipeline.resample import Exact
from pipeline.shot import Motion, Resampling


def step_into(motion: Motion, flow: Flow, frame: int) -> FrameStep:
    """Return the step of the flow that leads into `frame`."""
    return FrameStep(motion.limit_steps(flow, frame), *motion.step(frame), frame)


class RestInterval:
    """The frames that share a surface at rest: the first frame's, or every `rest_interval`-th after it.

    The cost of carrying points grows with the interval, so a new surface at rest bounds it. Intervals follow
    from frame numbers, so that a run resumed at any frame has the same ones.

    end  the frame whose surface is the next one at rest
    """

    def __init__(self, motion: Motion, resampling: Resampling, flow: Flow, number: int) -> None:
        first, length = motion.frames.first, resampling.rest_interval
        start = first + (number - first) // length * length
        self.end = start + length
        self.history = FlowMap()
        for frame in range(start + 1, number + 1):
            self.history.add(step_into(motion, flow, frame))
        project = motion.subject.project if start == first else None
        self.placement = Exact(self.history.carry, project, tags_creases=False)
        self._next = partial(RestInterval, motion, resampling, flow, self.end)

    def next(self) -> RestInterval:
        """Return the interval that begins at `end`."""
        return self._next()
