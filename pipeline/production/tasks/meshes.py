"""From a shot to surfaces and cameras: simulate, smooth the normals, frame."""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.animation import MeshFrame, animate, material_of
from pipeline.arrays import AnyArray, Floats
from pipeline.errors import FlowsculptError, FrameError, MeshError, UsageError
from pipeline.mesh.bspline import bspline_surface, bspline_values
from pipeline.mesh.normals import split_at_creases
from pipeline.mesh.patches import spread, tessellate
from pipeline.production.framing import Balls, frame_all, turned, with_room
from pipeline.production.npz import read_npz, write_npz
from pipeline.production.store import CorruptFileError
from pipeline.production.tasks.context import Context
from pipeline.shot.cloud import RADIUS


def simulate(context: Context) -> bool:
    """Make the missing mesh frames of a shot, going on from the last stored frame before them."""
    take, store = context.take, context.store
    missing = set(context.job.frames)
    started = time.perf_counter()
    number = min(missing)
    try:
        for frame in animate(take.shot, resume=_last_before(context, number)):
            number = frame.number
            key, target = take.mesh_key(number), take.motion_folders.mesh(number)
            found = store.holds("mesh", key)
            store.put("mesh", key, partial(write_npz, arrays=frame.to_arrays()))
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


def smooth_normals(context: Context) -> bool:
    """Give mesh frames their normals, vertices split at the creases, and cut their curved patches.

    Of control nets the smooth surface is made; points stay points, for spheres need no normals.
    """
    take = context.take

    def work(number: int) -> bool:
        target = take.motion_folders.normals(number)

        def write(path: Path) -> None:
            frame = read_mesh_frame(context, number)
            write_npz(path, _spheres(frame) if _is_cloud(frame) else _shaded(context, frame))

        return context.make("normals", take.normals_key(number), target, write)

    return context.each(context.job.frames, work)


def frame_camera(context: Context) -> bool:
    """Look at all the mesh frames of a take and find each picture's camera and stage."""
    take = context.take
    poses = list(take.poses.items())

    def points_of(index: int) -> Balls:
        pose = poses[index][1]
        frame = read_mesh_frame(context, pose.mesh)
        points, radii = frame.mesh.vertices, _radii(frame)
        if frame.lattice is not None:
            points = bspline_surface(points, frame.lattice, take.shot.picture.tessellate).vertices
            radii = np.zeros(len(points))
        return Balls(turned(points, pose.spin), radii)

    def write(path: Path) -> None:
        views = [take.view(number) for number, _ in poses]
        framings = frame_all(views, points_of, take.quality.aspect, still=take.turntable is not None)
        framings = [with_room(framing, take.shot.picture.stage) for framing in framings]
        data = {str(n): framing.as_data() for (n, _), framing in zip(poses, framings, strict=True)}
        path.write_text(json.dumps(data))

    started = time.perf_counter()
    try:
        found = context.make("cameras", take.cameras_key, take.folders.cameras(), write)
    except FlowsculptError as error:
        context.survey({pose.mesh for _, pose in poses}, lambda number: read_mesh_frame(context, number))
        context.fail(error)
        return False
    each = (time.perf_counter() - started) / len(poses)
    for number, _ in poses:
        context.tell(number, found, each)
    return True


def _is_cloud(frame: MeshFrame) -> bool:
    return not len(frame.mesh.faces)


def _radii(frame: MeshFrame) -> Floats:
    """(V,) of the spheres around vertices: none where there are faces."""
    return frame.mesh.attributes[RADIUS] if _is_cloud(frame) else np.zeros(len(frame.mesh.vertices))


def _spheres(frame: MeshFrame) -> dict[str, AnyArray]:
    points = frame.mesh.vertices
    return {
        "vertices": points.astype(np.float32),
        "radii": _radii(frame).astype(np.float32),
        "source_vertex": np.arange(len(points), dtype=np.int32),
        "material": material_of(frame.mesh).astype(np.float32),
    }


def _shaded(context: Context, frame: MeshFrame) -> dict[str, AnyArray]:
    mesh, pieces = frame.mesh, context.take.shot.picture.tessellate
    if frame.lattice is not None:
        shaded = bspline_surface(mesh.vertices, frame.lattice, pieces)
        material = bspline_values(material_of(mesh), frame.lattice, pieces)
    else:
        split = split_at_creases(mesh, context.take.thresholds(frame.number).hard_angles(mesh))
        shaded = tessellate(split, pieces)
        material = spread(material_of(mesh), split, shaded)
    return {
        "vertices": shaded.vertices.astype(np.float32),
        "normals": shaded.normals.astype(np.float32),
        "faces": shaded.faces,
        "source_vertex": shaded.source_vertex,
        "material": material.astype(np.float32),
    }


def read_mesh_frame(context: Context, number: int) -> MeshFrame:
    """A mesh frame from the store. Raises FrameError where it is missing or corrupt."""
    take = context.take

    def reader(path: Path) -> MeshFrame:
        try:
            return MeshFrame.from_arrays(read_npz(path))
        except (UsageError, MeshError) as error:
            raise CorruptFileError(f"{path}: {error}") from error

    return context.read("mesh", take.mesh_key(number), take.motion_folders.mesh(number), reader)


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
