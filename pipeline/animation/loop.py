"""The frame loop: displace, resample, yield; resumable from any frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np

from pipeline.animation.frame import MeshFrame
from pipeline.animation.queries import marked
from pipeline.animation.rest_interval import Epoch, step_into
from pipeline.animation.surface import Carried, Sliced, Surface, Triangular, thresholds_at
from pipeline.arrays import AnyArray, Floats, Vectors
from pipeline.errors import UsageError
from pipeline.flow import Displacement, Flow, as_flow
from pipeline.mesh import PolygonMesh, TriangleMesh, vertex_normals
from pipeline.mesh.identity import with_identities
from pipeline.mesh.normals import NORMAL
from pipeline.resample import (
    Chord,
    Curved,
    Placement,
    PolyhedralResampler,
    Resampler,
    Thresholds,
    edges_by_angle,
)
from pipeline.resample.creases import edges_in_region
from pipeline.resample.placement.rest_surface import REST
from pipeline.shot import Motion, Resampling, Shot


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


Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)

_UNCARRIED: Mapping[str, Placement] = {"chord": Chord(), "curved": Curved()}


def at_rest(motion: Motion, flow: Flow) -> Surface:
    """The subject before anything has moved it, not resampled yet.

    Raises UsageError where points are to be resampled.
    """
    resampling, first = motion.resampling, motion.frames.first
    if resampling is None:
        return Surface(marked(with_identities(motion.mesh_at_rest())), motion.subject.lattice)
    if not motion.subject.is_surface:
        raise UsageError("points and control nets are not resampled; take resampling out of the motion")
    thresholds = thresholds_at(motion, resampling, first)
    if resampling.method == "polyhedra":
        polygons = marked(motion.polygons_at_rest())
        polygons = _creased(polygons, resampling, _hard_angles(polygons, thresholds))
        slicer = PolyhedralResampler(polygons, thresholds, resampling.cutting, resampling.collapse)
        return Sliced(motion, resampling, slicer)
    mesh = with_identities(motion.mesh_at_rest())
    mesh = _creased(mesh, resampling, thresholds.hard_angles(mesh))
    if resampling.placement != "exact":
        placement, splits = _UNCARRIED[resampling.placement], resampling.splits
        return Triangular(
            motion,
            resampling,
            Resampler(marked(mesh), thresholds, placement, resampling.min_roundness, splits),
        )
    if resampling.normals == "carried":
        mesh = mesh.with_attributes(**{NORMAL: _normals_at_rest(motion, mesh)})
    epoch = Epoch(motion, resampling, flow, first)
    resampler = Resampler(mesh, thresholds, epoch.placement, resampling.min_roundness, resampling.splits)
    return Carried(motion, resampling, resampler, epoch)


def _creased(mesh: Mesh, resampling: Resampling, hard_angles: float | Floats) -> Mesh:
    """The mesh at rest with the edges tagged that are to stay hard (P31)."""
    if resampling.creases == "model":
        return mesh
    if resampling.creases == "none":
        return mesh.with_creases([])
    if resampling.creases == "rest":
        return mesh.with_creases(edges_by_angle(mesh, hard_angles))
    return mesh.with_creases(edges_in_region(mesh, resampling.creases))


def _hard_angles(polygons: PolygonMesh, thresholds: Thresholds) -> float | Floats:
    """Radians; functions are asked on triangles, whose first vertices are those of the polygons."""
    angles = thresholds.hard_angles(polygons.triangulated())
    return angles if isinstance(angles, float) else angles[: len(polygons.vertices)]


def _normals_at_rest(motion: Motion, mesh: TriangleMesh) -> Vectors:
    """(V, 3): of the true surface where it is known, else of the mesh; zero at creases."""
    truth = motion.subject.project
    normals = vertex_normals(mesh) if truth is None else truth.normals(mesh.vertices)
    normals[mesh.creases.ravel()] = 0.0
    return normals


def resumed(motion: Motion, flow: Flow, frame: MeshFrame) -> Surface:
    """The surface as it was when its frame was taken: vertices and faces keep their order.

    Raises UsageError where the frame lacks what the shot's way of resampling goes on from.
    """
    resampling = motion.resampling
    if resampling is None:
        return Surface(frame.mesh, frame.lattice)
    thresholds = thresholds_at(motion, resampling, frame.number)
    if resampling.method == "polyhedra":
        polygons = _required_polygons(frame)
        state = _state(polygons, offsets=polygons.offsets, corners=polygons.corners)
        slicer = PolyhedralResampler.from_state(state, thresholds, resampling.cutting, resampling.collapse)
        return Sliced(motion, resampling, slicer)
    state = _state(frame.mesh, faces=frame.mesh.faces, identities=np.array(frame.identities))
    if resampling.placement != "exact":
        placement, splits = _UNCARRIED[resampling.placement], resampling.splits
        resampler = Resampler.from_state(state, thresholds, placement, resampling.min_roundness, splits)
        return Triangular(motion, resampling, resampler)
    _require_rest(frame)
    epoch = Epoch(motion, resampling, flow, frame.number)
    resampler = Resampler.from_state(
        state, thresholds, epoch.placement, resampling.min_roundness, resampling.splits
    )
    return Carried(motion, resampling, resampler, epoch)


def _state(mesh: TriangleMesh | PolygonMesh, **others: AnyArray) -> dict[str, AnyArray]:
    """What a resampler keeps as its state, of a mesh."""
    attributes = {f"attribute.{name}": values for name, values in mesh.attributes.items()}
    return {"vertices": mesh.vertices, **others, **attributes, "creases": mesh.creases}


def _required_polygons(frame: MeshFrame) -> PolygonMesh:
    if frame.polygons is None:
        raise UsageError(
            f"frame {frame.number} has no polygons, which method polyhedra goes on from; "
            "resume from a frame that was made with it"
        )
    return frame.polygons


def _require_rest(frame: MeshFrame) -> None:
    if REST not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no vertex attribute {REST!r}, which exact placement goes on from; "
            "resume from a frame that was made with exact placement"
        )
