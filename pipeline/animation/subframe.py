"""The surface between frames, without simulating again: for shutters, and for looking closer."""

from __future__ import annotations

from pipeline.animation.frame import MeshFrame
from pipeline.errors import UsageError
from pipeline.flow import checked_displacement
from pipeline.mesh import TriangleMesh
from pipeline.shot import Motion

FURTHEST = 1.0
"""Frames: beyond, the surface has been resampled, and another frame is nearer."""


def at_moment(motion: Motion, frame: MeshFrame, moment: float) -> TriangleMesh:
    """The mesh of a frame, where the flow has it at a moment: 12.5 lies between the frames 12 and 13.

    The vertices and faces are those of `frame`, in their order, moved by the very flow for the exact time,
    speed curves included. At the moment of the next frame they are where the simulation has them before it
    resamples. A moment before the frame runs the flow backwards.

    Raises UsageError where the moment is more than FURTHEST from the frame, FrameError where the flow fails.
    """
    if not abs(moment - frame.number) <= FURTHEST:
        raise UsageError(
            f"moment {moment:g} is more than a frame from frame {frame.number}; take a nearer one"
        )
    time, dt = motion.clock.between(frame.number, moment)
    flow = motion.bounded(motion.flow, frame.number + (moment > frame.number))
    moved = checked_displacement(flow, frame.mesh.vertices, time, dt, frame.number)
    return TriangleMesh(moved, frame.mesh.faces, creases=frame.mesh.creases)
