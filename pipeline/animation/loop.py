"""The frame loop: displace, resample, yield; resumable from any frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from pipeline.animation.frame import Mesh, MeshFrame, with_material
from pipeline.animation.moving_surface import (
    ExactSurface,
    MovingSurface,
    PolygonSurface,
    RestInterval,
    TriangleSurface,
    step_into,
    thresholds_at,
)
from pipeline.arrays import AnyArray, Floats, Vectors
from pipeline.errors import UsageError
from pipeline.flow import Displacement, Flow, as_flow
from pipeline.mesh import PolygonMesh, TriangleMesh
from pipeline.mesh.identity import with_identities
from pipeline.mesh.normals import NORMAL, vertex_normals
from pipeline.resample import PolyhedralResampler, Resampler, Thresholds, edges_by_angle
from pipeline.resample.creases import edges_in_region
from pipeline.resample.resampler import STATELESS
from pipeline.resample.rest_surface import REST
from pipeline.shot import Motion, Resampling, Shot


def animate(
    shot: Shot | Motion,
    resume: MeshFrame | None = None,
    flow: Flow | Displacement | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Iterator[MeshFrame]:
    """Yield the shot's frames in order: each moved by the flow for one frame, then resampled once (P6).

    The first frame is the subject at rest, resampled only. With `resume`, yields the frames after that one,
    with the same bits as an uninterrupted run. `flow` replaces the shot's own: any callable `points, time, dt
    -> points` (P1). `ready` is called before the arrays of each frame are copied: who still holds those of
    the frame before may free them first.

    Raises FrameError, with its `frame`, where the flow fails or the surface cannot be resampled; the frames
    before it have been yielded. MeshError and MissingInputError for an unusable subject.
    """
    motion = shot.motion if isinstance(shot, Shot) else shot
    acting = motion.flow if flow is None else as_flow(flow)
    if resume is None:
        number = motion.frames.first
        surface = at_rest(motion, acting)
        yield surface.frame(number, ready)
    else:
        number = resume.number
        surface = resumed(motion, acting, resume)
        del resume  # its arrays are copied, and take memory while frames are computed
    for frame in range(number + 1, motion.frames.last + 1):
        surface.move(step_into(motion, acting, frame))
        yield surface.frame(frame, ready)


def at_rest(motion: Motion, flow: Flow) -> MovingSurface:
    """Return the subject before anything has moved it, not resampled yet.

    Raises UsageError where points are to be resampled.
    """
    resampling, first = motion.resampling, motion.frames.first
    if resampling is None:
        mesh = with_material(with_identities(motion.mesh_at_rest()))
        return MovingSurface(motion, mesh, motion.subject.lattice)
    if not motion.subject.is_surface:
        raise UsageError("points and control nets are not resampled; leave out resampling")
    thresholds = thresholds_at(motion, resampling, first)
    if resampling.method == "polyhedra":
        polygons = with_material(motion.polygons_at_rest())
        polygons = _creased(polygons, resampling, _hard_angles(polygons, thresholds))
        polyhedral = PolyhedralResampler(polygons, thresholds, resampling.cutting, resampling.collapse)
        return PolygonSurface(motion, resampling, polyhedral)
    mesh = with_identities(motion.mesh_at_rest())
    mesh = _creased(mesh, resampling, thresholds.hard_angles(mesh))
    if resampling.placement != "exact":
        mesh = with_material(mesh)
    elif resampling.normals == "carried":
        mesh = mesh.with_attributes(**{NORMAL: _normals_at_rest(motion, mesh)})
    return _triangle_surface(motion, resampling, flow, first, partial(Resampler, mesh, thresholds))


def _triangle_surface(
    motion: Motion,
    resampling: Resampling,
    flow: Flow,
    frame: int,
    resampler: Callable[..., Resampler],
    start_vertices: int | None = None,
) -> TriangleSurface:
    """Return the surface of a resampler, made with the placement that the shot names."""
    options = resampling.min_roundness, resampling.splits
    if resampling.placement != "exact":
        placed = resampler(STATELESS[resampling.placement], *options)
        return TriangleSurface(motion, resampling, placed, start_vertices)
    interval = RestInterval(motion, resampling, flow, frame)
    placed = resampler(interval.placement, *options)
    return ExactSurface(motion, resampling, placed, interval, start_vertices)


def _creased(mesh: Mesh, resampling: Resampling, hard_angles: float | Floats) -> Mesh:
    """Return the mesh at rest with the edges tagged that are to stay hard (P31)."""
    if resampling.creases == "model":
        return mesh
    if resampling.creases == "none":
        return mesh.with_creases([])
    if resampling.creases == "rest":
        return mesh.with_creases(edges_by_angle(mesh, hard_angles))
    return mesh.with_creases(edges_in_region(mesh, resampling.creases))


def _hard_angles(polygons: PolygonMesh, thresholds: Thresholds) -> float | Floats:
    """Return hard angles, radians; functions are evaluated on the triangulated polygons."""
    angles = thresholds.hard_angles(polygons.triangulated())
    return angles if isinstance(angles, float) else angles[: len(polygons.vertices)]


def _normals_at_rest(motion: Motion, mesh: TriangleMesh) -> Vectors:
    """Return normals (V, 3) of the analytic surface if it is known, else of the mesh; zero at creases."""
    truth = motion.analytic_surface()
    normals = vertex_normals(mesh) if truth is None else truth.normals(mesh.vertices)
    normals[mesh.creases.ravel()] = 0.0
    return normals


def resumed(motion: Motion, flow: Flow, frame: MeshFrame) -> MovingSurface:
    """Return the surface as it was at a frame; vertices and faces keep their order.

    Raises UsageError where the frame lacks what the shot's resampling resumes from.
    """
    resampling = motion.resampling
    if resampling is None:
        return MovingSurface(motion, frame.mesh, frame.lattice)
    thresholds = thresholds_at(motion, resampling, frame.number)
    if resampling.method == "polyhedra":
        polygons = frame.polygons
        if polygons is None:
            raise UsageError(
                f"frame {frame.number} has no polygons to continue with method polyhedra; resume from a "
                "frame made with it"
            )
        state = _state(polygons, offsets=polygons.offsets, corners=polygons.corners)
        polyhedral = PolyhedralResampler.from_state(
            state, thresholds, resampling.cutting, resampling.collapse
        )
        return PolygonSurface(motion, resampling, polyhedral, _start_vertices(motion, flow, frame))
    numbers = {"identities": np.array(frame.identities), "unsorted": np.array(frame.unsorted)}
    state = _state(frame.mesh, faces=frame.mesh.faces, **numbers)
    if resampling.placement == "exact" and REST not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no vertex attribute {REST!r}, which exact placement needs; resume "
            "from a frame made with exact placement"
        )
    resume = partial(Resampler.from_state, state, thresholds)
    start_vertices = _start_vertices(motion, flow, frame)
    return _triangle_surface(motion, resampling, flow, frame.number, resume, start_vertices)


def _start_vertices(motion: Motion, flow: Flow, frame: MeshFrame) -> int | None:
    """Return the number of vertices of the first frame, by which `max_growth` is measured.

    Frames of earlier versions do not state it; the first frame is then computed again where a limit is set.
    """
    known = frame.report.start_vertices
    if known is not None or motion.resampling is None or motion.resampling.max_growth is None:
        return known
    start = at_rest(motion, flow).frame(motion.frames.first, lambda: None)
    return len(start.mesh.vertices)


def _state(mesh: TriangleMesh | PolygonMesh, **others: AnyArray) -> dict[str, AnyArray]:
    """Return the state of a resampler with this mesh."""
    attributes = {f"attribute.{name}": values for name, values in mesh.attributes.items()}
    return {"vertices": mesh.vertices, **others, **attributes, "creases": mesh.creases}
