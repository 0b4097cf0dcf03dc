"""The frame loop: displace, resample, yield; resumable from any frame."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.animation.epoch import step_into
from pipeline.animation.frame import MeshFrame
from pipeline.animation.start import at_rest, resumed
from pipeline.flow import Displacement, Flow, as_flow
from pipeline.shot import Motion, Shot


def animate(
    shot: Shot | Motion, resume: MeshFrame | None = None, flow: Flow | Displacement | None = None
) -> Iterator[MeshFrame]:
    """The shot's frames in order: each moved by the flow for one frame, then resampled once (P6).

    The first frame is the subject at rest, resampled only. With `resume`, the frames after that one,
    with the same bits as if the run had never stopped. `flow` takes the place of the shot's own:
    any callable `points, time, dt -> points` will do (P1).

    Raises FrameError, with its `frame`, where the flow fails or the surface cannot be resampled;
    the frames before it have been yielded. MeshError and MissingInputError where the subject is no good.
    """
    motion = shot.motion if isinstance(shot, Shot) else shot
    moving = motion.flow if flow is None else as_flow(flow)
    if resume is None:
        number = motion.frames.first
        surface = at_rest(motion, moving)
        yield surface.frame(number)
    else:
        number = resume.number
        surface = resumed(motion, moving, resume)
    for frame in range(number + 1, motion.frames.last + 1):
        surface.move(step_into(motion, moving, frame))
        yield surface.frame(frame)
