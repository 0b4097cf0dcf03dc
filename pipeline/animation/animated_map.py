"""The map of an animated model: where its files have a point at rest, and then the flows since the first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Points, Vectors
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep
from flowsculpt.pipeline.mesh.normals import carried_normals
from flowsculpt.pipeline.resample.placement import Ends
from flowsculpt.pipeline.shot.motion import VELOCITY_STEP, AnimatedSubject, without_animation


class AnimatedMap(FlowMap):
    """Carries points of an animated model at rest to a frame.

    The flows act on the surface as its files have it at the frame, for the time since the first one: they
    deform space, through which the model moves.
    """

    def __init__(self, subject: AnimatedSubject) -> None:
        super().__init__()
        self._subject, self._motion = subject, subject.motion.without_animation
        self._number = self._motion.frames.first

    def add(self, step: FrameStep) -> None:
        super().add(replace(step, flow=without_animation(step.flow)))
        self._number = step.frame

    def nearest(self, points: Points, ends: Ends) -> tuple[Points, AnyArray]:
        return self._subject.nearest(points, *ends)

    def carried(self, rest: Points, faces: AnyArray) -> Points:
        return super().carry(self._subject.points(rest, faces, self._seconds))

    def carry_given(self, given: Callable[[float], Points]) -> tuple[Points, Vectors]:
        """Return points (N, 3) at the last frame, and their velocities, units per second of the flow.

        given  returns where the files have them at a time of the flow
        """
        step = VELOCITY_STEP / float(self._motion.rate.fps)
        ends = []
        for ahead in (-step, step):
            points = super().carry(given(self._seconds + ahead))
            flow = self._motion.limit_steps(self._motion.flow, self._number + (ahead > 0.0))
            ends.append(FrameStep(flow, self._seconds, ahead, self._number).apply(points))
        return super().carry(given(self._seconds)), np.asarray((ends[1] - ends[0]) / (2.0 * step))

    def carry_normals(self, points: Points) -> Vectors | None:
        """Return normals (V, 3) at vertices (V, 3) of the last frame, 0 where unknown; None without any."""
        normals = self._subject.normals(self._seconds)
        if normals is None or not self._motion.flow.members:
            return normals
        return carried_normals(super().carry, self._subject.vertices(self._seconds), points, normals)

    @property
    def _seconds(self) -> float:
        return self._motion.clock.flow_time(self._number)
