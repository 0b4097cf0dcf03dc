"""From a shot to surfaces and cameras: simulate, smooth the normals, frame."""

from __future__ import annotations

import ctypes
import json
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from flowsculpt.pipeline.animation import FrameProgress, MeshFrame, animate
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import FlowsculptError, FrameError
from flowsculpt.pipeline.mesh.control_net import bspline_surface
from flowsculpt.pipeline.production.request.cameras import note_framing
from flowsculpt.pipeline.production.request.framing import BoundingSpheres, Extent, Framer, rotate_y
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.shot.motion import given_subject
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.base.work_clock import Timing, WorkClock

LARGE = 100_000
"""A mesh frame of at least so many vertices that nobody asks for is stored only now and then."""

KEPT_SECONDS = 30.0
"""The time of simulation that a killed job may lose in large frames that nobody asks for."""

HELD_BYTES = 1 << 27
"""Bytes of points that framing holds from its first look at them to its second."""

M_MMAP_THRESHOLD, MAPPED_BYTES = -3, 1 << 22
"""The parameter of glibc's `mallopt`, and its value for simulations."""


def simulate(context: Context) -> bool:
    """Make the missing mesh frames of a shot, going on from the last stored frame before them."""
    request = context.request
    missing = {number for number in context.job.frames if not _shown_again(context, number)}
    if not missing:
        return True
    return_freed_memory()
    last, is_given = max(missing), given_subject(request.shot.motion) is not None
    resume = None if is_given else _last_before(context, min(missing))
    begins = resume is None
    try:
        with _FrameWriter(context, missing) as writer:
            report = partial(_report_progress, context)
            only = frozenset(missing) if is_given else None
            frames = animate(request.shot, resume, ready=writer.wait, progress=report, only=only)
            del resume  # the generator drops it too, once the simulation has begun
            for frame in frames:
                if begins:
                    _tell_notes(context)
                    begins = False
                number = frame.number
                writer.take(frame)
                del frame  # so that it takes no memory once it is written
                if number == last:
                    break
    except FlowsculptError as error:
        context.fail(error, error.frame if isinstance(error, FrameError) and error.frame else min(missing))
        return False
    return True


class _FrameWriter:
    """Stores the mesh frames of a job, each in a thread while the next one is computed.

    missing  the frames of the job that are not shown yet; those that are written are removed
    """

    def __init__(self, context: Context, missing: set[int]) -> None:
        self._context, self._missing = context, missing
        self._pool = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None
        self._began = self._stored = time.perf_counter()
        self._clock = WorkClock()

    def __enter__(self) -> _FrameWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the frame that is being written; raise its error, even where the next frame failed too."""
        self._pool.shutdown()
        self.wait()

    def take(self, frame: MeshFrame) -> None:
        """Begin to store a frame, once the one before is stored. Raises MachineError where that failed."""
        self.wait()
        context, now = self._context, time.perf_counter()
        number, arrays, seconds = frame.number, None, now - self._began
        if not context.has("mesh", context.request.keys.mesh(number)) and self._is_stored(frame, now):
            arrays, self._stored = frame.to_arrays(), now
        self._writing = self._pool.submit(self._store, number, arrays, seconds)
        self._began = time.perf_counter()

    def _is_stored(self, frame: MeshFrame, now: float) -> bool:
        """Tell whether a frame is stored: one that is asked for, or that a killed job should go on from."""
        is_due = len(frame.own.vertices) < LARGE or now - self._stored > KEPT_SECONDS
        return frame.number in self._missing or is_due

    def _store(self, number: int, arrays: Mapping[str, AnyArray] | None, seconds: float) -> None:
        context, key = self._context, self._context.request.keys.mesh(number)
        started = time.perf_counter()
        if arrays is not None:
            write = readers.StoredFiles.writer(key, arrays)
            context.store.put("mesh", key, write, replace=context.is_forced)
        if number in self._missing:
            place = context.request.place("mesh", number)
            context.store.link("mesh", key, place, replace=context.is_forced)
            taken = Timing(seconds + time.perf_counter() - started, self._clock.lap().cpu)
            context.report(number, arrays is None, taken)
            self._missing.discard(number)
        else:
            context.report_work(self._clock.lap().cpu)

    def wait(self) -> None:
        """Wait until no frame is being stored, so that it takes no memory. Raises MachineError."""
        if self._writing is not None:
            writing, self._writing = self._writing, None
            writing.result()


def return_freed_memory() -> None:
    """Have the C library give the memory of large arrays back to the system as soon as they are freed.

    glibc keeps what was freed of blocks up to 32 MiB, in pieces that fit no array of the next frame: with a
    million vertices, a third of all memory. Blocks of the size of a few thousand vertices stay with it, which
    takes less time. Other C libraries go on as they do.
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED_BYTES)


def _tell_notes(context: Context) -> None:
    """Warn of what was repaired in the file of the subject, and of its place; once for each content."""
    request = context.request
    for line in request.source.new_notes():
        context.warn(request.shot.frames.first, f"{request.name}: {line}")


def _report_progress(context: Context, progress: FrameProgress) -> None:
    """Write how far a frame is, and why it takes long, to the event log."""
    context.write("progress", progress.frame, share=round(progress.share, 3), activity=progress.work)
    if progress.slow:
        context.write("slow", progress.frame, message=progress.slow)


def _shown_again(context: Context, number: int) -> bool:
    """Show a mesh frame that the store has by now, made by an earlier attempt that was killed."""
    key = context.request.keys.mesh(number)
    if not context.has("mesh", key):
        return False
    context.store.link("mesh", key, context.request.place("mesh", number))
    context.report(number, True, Timing(0.0, 0.0))
    return True


def _last_before(context: Context, number: int) -> MeshFrame | None:
    """Return the latest readable mesh frame before `number`, to go on from."""
    request = context.request
    for earlier in sorted((n for n in request.shot.motion.frames if n < number), reverse=True):
        if context.has("mesh", request.keys.mesh(earlier)):
            with suppress(FrameError):
                return read_mesh_frame(context, request, earlier)
    return None


def smooth_normals(context: Context) -> bool:
    """Give mesh frames their normals, vertices split at the creases, and cut their curved patches.

    Control nets become their smooth surface; points stay points, for spheres need no normals.
    """
    request = context.request
    return_freed_memory()

    def work(number: int) -> bool:
        key = request.keys.normals(number)

        def write(path: Path) -> None:
            readers.StoredFiles.writer(key, shading_of(context, request, number).stored())(path)

        return context.make("normals", key, request.place("normals", number), write)

    return context.for_each(context.job.frames, work)


def frame_camera(context: Context) -> bool:
    """Find each picture's camera and stage from all the mesh frames of a request."""
    return_freed_memory()
    request = context.request
    angles = request.angles
    # Pictures of one mesh and spin share a camera: lights move none.
    firsts = {(angle.mesh, angle.spin): number for number, angle in reversed(angles.items())}
    framed = sorted(firsts.values())

    held: dict[int, BoundingSpheres] = {}

    def points_of(index: int) -> BoundingSpheres:
        angle = angles[framed[index]]
        if index in held:  # framing looks at each frame twice
            return held.pop(index)
        extent = _spheres(context, angle.mesh)
        assert isinstance(extent, BoundingSpheres), "meshes are spheres without a radius"
        extent = extent._replace(points=rotate_y(extent.points, angle.spin))
        if (1 + len(held)) * extent.points.nbytes <= HELD_BYTES:
            held[index] = extent
        return extent

    def write(path: Path) -> None:
        picture, pictures = request.shot.picture, request.pictures
        views, follow = [pictures.view(number) for number in framed], picture.camera.follow
        framings = Framer(views, points_of, pictures.aspect, follow, pictures.is_round).all()
        framings = [each.with_stage_in_view(picture.stage, pictures.flat_aspect) for each in framings]
        plain = {number: to_plain(framing) for number, framing in zip(framed, framings, strict=True)}
        data = {str(number): plain[firsts[angle.mesh, angle.spin]] for number, angle in angles.items()}
        path.write_text(json.dumps(data), encoding="utf-8")

    clock = WorkClock()
    try:
        found = context.make("cameras", request.keys.cameras, request.folders.cameras(), write)
    except FlowsculptError as error:
        for part in request.parts:
            context.survey({angle.mesh for angle in angles.values()}, partial(read_mesh_frame, context, part))
        context.fail(error)
        return False
    _remember_keys(context)
    taken = clock.lap()
    each = Timing(taken.seconds / len(angles), taken.cpu / len(angles))
    for number in angles:
        context.report(number, found, each)
    return True


def _spheres(context: Context, number: int) -> Extent:
    """Return what a camera must show of a mesh frame. Raises what `read_mesh_frame` raises."""
    parts = context.request.parts
    spheres = [_spheres_of(context, part, number) for part in parts]
    return BoundingSpheres.join(spheres, [part.source.subject for part in parts])


def _spheres_of(context: Context, request: RenderRequest, number: int) -> BoundingSpheres:
    """Return what a camera must show of one subject."""
    key = request.keys.mesh(number)
    if request.shot.motion.subject.is_surface:
        points = context.read("mesh", key, request.place("mesh", number), readers.vertices(key))
        return BoundingSpheres(points, np.zeros(len(points)))
    frame = read_mesh_frame(context, request, number)
    if frame.lattice is None:
        return BoundingSpheres(frame.mesh.vertices, frame.radii)
    points = bspline_surface(frame.mesh.vertices, frame.lattice, request.shot.picture.tessellate).vertices
    return BoundingSpheres(points, np.zeros(len(points)))


def _remember_keys(context: Context) -> None:
    """Cache the keys of the pictures asked for, for later jobs: now their cameras are known."""
    note_framing(context.request)
    keys = context.picture_keys(context.request)
    for number in context.request.requested:
        with suppress(FlowsculptError):  # whoever makes that picture reports it
            keys[number]
    keys.remember()


def shading_of(context: Context, request: RenderRequest, number: int) -> Shading:
    """Return how a mesh frame of a request is shaded. Raises what `read_mesh_frame` raises."""
    frame, picture = read_mesh_frame(context, request, number), request.shot.picture
    return Shading.of(frame, request.shot.motion.thresholds_at(number), picture.tessellate)


def read_mesh_frame(context: Context, request: RenderRequest, number: int) -> MeshFrame:
    """Read a mesh frame of a request from the store. Raises FrameError where it is missing or corrupt."""
    key = request.keys.mesh(number)
    return context.read("mesh", key, request.place("mesh", number), readers.mesh_frame(key, number))
