"""The frame loop: displace, resample, yield; resumable from any frame, and reporting its progress.

A slow frame says once what it does and what makes it slow.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from typing import NamedTuple

from flowsculpt.pipeline.animation.frame import MeshFrame
from flowsculpt.pipeline.animation.motion_forecast import MotionForecast
from flowsculpt.pipeline.animation.simulated_surfaces import at_rest, resumed
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow import Displacement, Flow, Streamlines, as_flow
from flowsculpt.pipeline.flow.flow_map import CARRYING
from flowsculpt.pipeline.long_computations import Progress
from flowsculpt.pipeline.shot import Motion, Shot
from flowsculpt.render.base.kernel_cache import compiled_seconds


def animate(
    shot: Shot | Motion,
    resume: MeshFrame | None = None,
    flow: Flow | Displacement | None = None,
    ready: Callable[[], None] = lambda: None,
    progress: FrameProgressCallback | None = None,
    only: Collection[int] | None = None,
) -> Iterator[MeshFrame]:
    """Yield the shot's frames in order: each moved by the flow for one frame, then resampled once (P6).

    The first frame is the subject at rest, resampled only. With `resume`, yields the frames after that one,
    with the same bits as an uninterrupted run. `flow` replaces the shot's own: any callable `points, time, dt
    -> points` (P1). `ready` is called before the arrays of each frame are copied: who still holds those of
    the frame before may free them first. `progress` hears of the progress within each frame that takes long.
    `only` names the frames to yield, of a motion whose frames are given.

    Raises FrameError, with its `frame`, where the flow fails or the surface cannot be resampled; the frames
    before it have been yielded. MeshError and MissingInputError for an unusable subject.
    """
    motion = shot.motion if isinstance(shot, Shot) else shot
    frames = _simulate_frames(motion, resume, motion.flow if flow is None else as_flow(flow), ready, only)
    return frames if progress is None else _report_frames(motion, resume, frames, progress)


def _simulate_frames(
    motion: Motion,
    resume: MeshFrame | None,
    acting: Flow,
    ready: Callable[[], None],
    only: Collection[int] | None,
) -> Iterator[MeshFrame]:
    """Yield the frames as `animate` does."""
    if resume is None:
        number = motion.frames.first
        surface = at_rest(motion, acting)
        if only is None or number in only:
            yield surface.frame(number, ready)
    else:
        number = resume.number
        surface = resumed(motion, acting, resume)
        del resume  # its arrays are copied, and take memory while frames are computed
    for frame in range(number + 1, motion.frames.last + 1):
        surface.move(motion.step_into(acting, frame))
        if only is None or frame in only:
            yield surface.frame(frame, ready)


SLOW_SECONDS = 60.0  # a frame that takes longer says why

MEASURED_SECONDS, FORESEEN = 3.0, 1.5
"""A frame is foreseen to be slow after so many seconds, where it would take so many times SLOW_SECONDS."""

REPORT_SECONDS = 0.5  # time between two reports of one frame, and before the first
GROWTH = 1.5  # vertices over those of the frame before from which on the stretch makes a frame slow
MOST_SHARE = 0.95  # the share of a frame that its flow takes at most: the resampler follows


class FrameProgress(NamedTuple):
    """The progress of the frame in work.

    frame     its number
    share     0 to 1, about
    activity  what is computed: the name of a flow, or of a part of the resampling
    vertices  number of vertices that the surface has by now
    slow      why the frame takes long, the first time that a flow makes one slow; else empty
    """

    frame: int
    share: float
    activity: str
    vertices: int
    slow: str = ""

    @property
    def work(self) -> str:
        """`curl_noise, 120,345 vertices`; without the vertices before the first are made."""
        return f"{self.activity}, {self.vertices:,} vertices" if self.vertices else self.activity


FrameProgressCallback = Callable[[FrameProgress], None]


EXTENT_SAMPLE = 1 << 16  # vertices whose extent stands for that of a surface with more of them


class _VertexSample(NamedTuple):
    """Some vertices (N, 3) of a surface, evenly by their numbers, and the number of all."""

    points: Points
    vertices: int

    @classmethod
    def of(cls, frame: MeshFrame) -> _VertexSample:
        points = frame.own.vertices if frame.copies is None else frame.copies.origins
        stride = len(points) // EXTENT_SAMPLE
        return cls(points if stride < 2 else points[::stride].copy(), len(points))


def _report_frames(
    motion: Motion, resume: MeshFrame | None, frames: Iterator[MeshFrame], callback: FrameProgressCallback
) -> Iterator[MeshFrame]:
    """Yield frames; report the progress within each that takes long."""
    told = set[str]()
    number = motion.frames.first if resume is None else resume.number + 1
    before = None if resume is None else _VertexSample.of(resume)
    del resume  # a frame that its taker has dropped takes no memory while the next one is computed
    while number <= motion.frames.last:
        with Progress.reported_to(_FrameWatch(motion, number, before, callback, told).receive):
            frame = next(frames, None)
        if frame is None:
            return
        number, before = frame.number + 1, _VertexSample.of(frame)
        yield frame
        del frame


def _working_seconds() -> float:
    """Return a time in seconds that stands still while kernels are compiled, once for all frames."""
    return time.monotonic() - compiled_seconds()


class _FrameWatch:
    """Turns the progress of computations into that of one frame."""

    def __init__(
        self,
        motion: Motion,
        frame: int,
        before: _VertexSample | None,
        callback: FrameProgressCallback,
        told: set[str],
    ) -> None:
        self._motion, self._frame, self._before, self._callback = motion, frame, before, callback
        self._reported = time.monotonic()
        self._began = _working_seconds()
        self._last = Progress("", 0, 0)
        self._moved = 0
        self._vertices = 0 if before is None else before.vertices
        self._is_explained, self._told = False, told

    def receive(self, progress: Progress) -> None:
        """Take progress of a flow or of the resampler."""
        if progress.is_once:
            self._began = _working_seconds()  # says nothing of the frame
            share = progress.done / progress.total
            self._callback(FrameProgress(self._frame, share, progress.activity, 0))
            return
        is_same = progress[::2] == self._last[::2] and progress.done > self._last.done
        if progress.total:
            self._moved += progress.done - (self._last.done if is_same else 0)
        else:
            self._vertices = progress.done
        self._last, now = progress, time.monotonic()
        if now - self._reported < REPORT_SECONDS:
            return
        self._reported = now
        share = self._share()
        slow = self._slow(_working_seconds() - self._began, share)
        self._callback(FrameProgress(self._frame, share, progress.activity, self._vertices, slow))

    def _share(self) -> float:
        """Return the share of the frame that is done, from 0 to MOST_SHARE."""
        expected = self._expected_moves()
        return min(MOST_SHARE, MOST_SHARE * self._moved / expected) if expected else 0.0

    def _expected_moves(self) -> int:
        """Return how many points the frame moves along velocities: vertices, and beside them for normals."""
        if self._before is None:
            return 0
        flow, resampling = self._motion.flow, self._motion.resampling
        steps = sum(isinstance(s.flow, Streamlines) for s in flow.steps(*self._motion.step(self._frame)))
        carried = (
            resampling is not None and resampling.placement == "exact" and resampling.normals == "carried"
        )
        return steps * self._before.vertices * (3 if carried else 1)

    def _slow(self, seconds: float, share: float) -> str:
        """Return why the frame is slow, the first time that this is known; else an empty text."""
        is_foreseen = seconds > MEASURED_SECONDS and share > 0.0 and seconds / share > FORESEEN * SLOW_SECONDS
        if self._is_explained or not (seconds > SLOW_SECONDS or is_foreseen):
            return ""
        self._is_explained = True
        place, reason = self._reason()
        if place in self._told:
            return ""
        self._told.add(place)
        takes = f"takes about {seconds / share:.0f} s" if is_foreseen else f"has taken {seconds:.0f} s so far"
        return f"frame {self._frame} {takes}: {reason}"

    def _reason(self) -> tuple[str, str]:
        """Return the place in the shot file that makes the frame slow, and why."""
        before, last = self._before, self._last
        if before is not None and not last.total and last.done > GROWTH * before.vertices:
            return "resample", (
                f"the flows stretch the surface from {before.vertices:,} vertices to {last.done:,}. Slow the "
                "flows down, or raise resample.max_edge_length."
            )
        costs = [] if before is None else MotionForecast(self._motion).costs(self._frame, *before)
        if before is None or not costs:
            count = last.done if before is None else before.vertices
            return "resample", f"{last.activity} has {count:,} vertices. Raise resample.max_edge_length."
        cost = costs[0]
        if last.activity != CARRYING:
            return cost.place, str(cost)
        more = "New vertices take those of all frames since rest: lower resample.rest_interval."
        return f"{cost.place}, carried", f"{cost} {more}"
