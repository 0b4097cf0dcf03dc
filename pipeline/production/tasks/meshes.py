"""From a shot to surfaces and cameras: simulate, smooth the normals, frame."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.animation import MeshFrame, animate
from pipeline.errors import FlowsculptError, FrameError
from pipeline.mesh.bspline import bspline_surface
from pipeline.production.render_inputs.framing import frame_all, turned, with_room
from pipeline.production.render_inputs.framing_geometry import Balls
from pipeline.production.render_inputs.shading import Shading, radii
from pipeline.production.store import readers
from pipeline.production.store.npz import write_npz
from pipeline.production.tasks.job import Context


def simulate(context: Context) -> bool:
    """Make the missing mesh frames of a shot, going on from the last stored frame before them."""
    take, store = context.take, context.store
    missing = {number for number in context.job.frames if not _shown_again(context, number)}
    if not missing:
        return True
    started = time.perf_counter()
    number = min(missing)
    try:
        for frame in animate(take.shot, resume=_last_before(context, number)):
            number = frame.number
            key, target = take.mesh_key(number), take.motion_folders.mesh(number)
            found = store.holds("mesh", key)
            store.put("mesh", key, partial(write_npz, arrays=readers.keyed(key, frame.to_arrays())))
            if number in missing:
                store.link("mesh", key, target)
                context.tell(number, found, time.perf_counter() - started)
                missing.discard(number)
            if not missing:
                break
            started = time.perf_counter()
    except FlowsculptError as error:
        context.fail(error, error.frame if isinstance(error, FrameError) and error.frame else min(missing))
        return False
    return True


def _shown_again(context: Context, number: int) -> bool:
    """Show a mesh frame that the store has by now, made by an earlier attempt that was killed."""
    key = context.take.mesh_key(number)
    if not context.store.holds("mesh", key):
        return False
    context.store.link("mesh", key, context.take.motion_folders.mesh(number))
    context.tell(number, True, 0.0)
    return True


def smooth_normals(context: Context) -> bool:
    """Give mesh frames their normals, vertices split at the creases, and cut their curved patches.

    Of control nets the smooth surface is made; points stay points, for spheres need no normals.
    """
    take = context.take

    def work(number: int) -> bool:
        key, target = take.normals_key(number), take.motion_folders.normals(number)

        def write(path: Path) -> None:
            write_npz(path, readers.keyed(key, shading_of(context, number).arrays()))

        return context.make("normals", key, target, write)

    return context.each(context.job.frames, work)


def frame_camera(context: Context) -> bool:
    """Look at all the mesh frames of a take and find each picture's camera and stage."""
    take = context.take
    poses = list(take.poses.items())
    stands = {(pose.mesh, pose.spin): number for number, pose in reversed(poses)}  # its lights move no camera
    shown = sorted(stands.values())

    def points_of(index: int) -> Balls:
        pose = take.poses[shown[index]]
        frame = read_mesh_frame(context, pose.mesh)
        points, around = frame.mesh.vertices, radii(frame)
        if frame.lattice is not None:
            points = bspline_surface(points, frame.lattice, take.shot.picture.tessellate).vertices
            around = np.zeros(len(points))
        return Balls(turned(points, pose.spin), around)

    def write(path: Path) -> None:
        views = [take.view(number) for number in shown]
        framings = frame_all(views, points_of, take.aspect, take.follow)
        framings = [with_room(framing, take.shot.picture.stage) for framing in framings]
        found = {number: framing.as_data() for number, framing in zip(shown, framings, strict=True)}
        data = {str(number): found[stands[pose.mesh, pose.spin]] for number, pose in poses}
        path.write_text(json.dumps(data))

    started = time.perf_counter()
    try:
        found = context.make("cameras", take.cameras_key, take.folders.cameras(), write)
    except FlowsculptError as error:
        context.survey({pose.mesh for _, pose in poses}, lambda number: read_mesh_frame(context, number))
        context.fail(error)
        return False
    _note_keys(context)
    each = (time.perf_counter() - started) / len(poses)
    for number, _ in poses:
        context.tell(number, found, each)
    return True


def _note_keys(context: Context) -> None:
    """Find the keys of the pictures asked for, now that their cameras are known: who makes them need not."""
    keys = context.picture_keys(context.take)
    for number in context.take.requested:
        with suppress(FlowsculptError):  # whoever makes that picture tells
            keys[number]
    keys.note()


def shading_of(context: Context, number: int) -> Shading:
    """How a mesh frame from the store is rendered. Raises as `read_mesh_frame` does."""
    take = context.take
    return Shading.of(read_mesh_frame(context, number), take.thresholds(number), take.shot.picture.tessellate)


def read_mesh_frame(context: Context, number: int) -> MeshFrame:
    """A mesh frame from the store. Raises FrameError where it is missing or corrupt."""
    take, key = context.take, context.take.mesh_key(number)
    return context.read("mesh", key, take.motion_folders.mesh(number), readers.mesh_frame(key))


def _last_before(context: Context, number: int) -> MeshFrame | None:
    """The latest readable mesh frame before `number`, to go on from."""
    take = context.take
    for earlier in sorted((n for n in take.shot.motion.frames if n < number), reverse=True):
        if context.store.holds("mesh", take.mesh_key(earlier)):
            try:
                return read_mesh_frame(context, earlier)
            except FrameError:
                continue
    return None
