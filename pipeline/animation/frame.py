"""MeshFrame: one frame of a shot's surface as it is stored, and what frames tell of vertices and time."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow import checked_displacement
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.control_net import Lattice
from flowsculpt.pipeline.mesh.halfedge_mesh import IDENTITY, Ancestry, ancestry
from flowsculpt.pipeline.mesh.normals import NORMAL
from flowsculpt.pipeline.mesh.placed_copies import COPIES, STARTS, Placements
from flowsculpt.pipeline.resample import PolygonReport, Report
from flowsculpt.pipeline.resample.placement import REST
from flowsculpt.pipeline.shot import Motion
from flowsculpt.pipeline.shot.animated_models import VELOCITY
from flowsculpt.pipeline.statistics import MeshStatistics
from flowsculpt.render.base.serialise import to_plain

_ATTRIBUTE = "attribute:"


@dataclass(frozen=True)
class FrameReport:
    """Report of one frame.

    resampling      report of the resampler; None where resampling is off
    measure         computes `statistics`; None for a point cloud
    start_vertices  number of vertices of the shot's first frame, which growth is measured by; None where
                    nothing is resampled
    """

    resampling: Report | None
    measure: Callable[[], MeshStatistics | None] | None = field(repr=False, compare=False)
    start_vertices: int | None = None

    @cached_property
    def statistics(self) -> MeshStatistics | None:
        """Statistics of the resulting mesh (P7); None for a point cloud.

        Computed on first use, which takes as long as resampling does; previews do not use it.
        """
        return None if self.measure is None else self.measure()

    def as_data(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        data = {"resampling": to_plain(self.resampling), "statistics": to_plain(self.statistics)}
        return data if self.start_vertices is None else {**data, "start_vertices": self.start_vertices}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> FrameReport:
        """Return the report from its JSON data."""
        resampling, statistics = data["resampling"], data["statistics"]
        kind = PolygonReport if resampling and "cuts" in resampling else Report
        return cls(
            resampling=None if resampling is None else kind(**resampling),
            measure=None if statistics is None else lambda: MeshStatistics(**statistics),
            start_vertices=data.get("start_vertices"),
        )


@dataclass(frozen=True)
class MeshFrame:
    """One frame of a shot's surface. With the shot, it is all that later frames depend on.

    own         the surface; of a cloud the points, without faces, their radii as the attribute `radius`; of a
                control net the points, with the net's own cells as faces; of rigid copies the one that all
                are copies of, around its middle
    polygons    the polygons that `mesh` was triangulated from, if the surface has polygons; their vertices
                are the first of the mesh's
    births      int64 (N, 3): the `identity` of each vertex born on the way into this frame, and those of its
                two parents, in order of birth; None where identities are not kept
    identities  the number of identities given since the first frame
    unsorted    number of vertices born since the resampler last sorted them
    lattice     layout of the control points, if the vertices are those of a control net
    copies      of rigid copies, their placements in this frame; else None
    starts      of rigid copies, their placements at rest; else None
    """

    number: int
    own: TriangleMesh
    report: FrameReport = FrameReport(None, None)
    polygons: PolygonMesh | None = None
    births: AnyArray | None = None
    identities: int = 0
    unsorted: int = 0
    lattice: Lattice | None = None
    copies: Placements | None = None
    starts: Placements | None = None

    @classmethod
    def at_rest(cls, number: int, mesh: TriangleMesh, lattice: Lattice | None = None) -> MeshFrame:
        """Return a frame that shows the undeformed surface, without a report."""
        return cls(number, with_material(mesh), FrameReport(None, lambda: None), lattice=lattice)

    @cached_property
    def mesh(self) -> TriangleMesh:
        """The surface; of rigid copies that of all, one after another, with material positions."""
        if self.copies is None or self.starts is None:
            return self.own
        mesh = self.copies.repeated(self.own)
        named = {MATERIAL: self.starts.points(self.own.vertices), IDENTITY: np.arange(len(mesh.vertices))}
        if NORMAL in self.own.attributes:
            named[NORMAL] = self.copies.directions(self.own.attributes[NORMAL])
        return mesh.with_attributes(**named)

    @property
    def is_cloud(self) -> bool:
        """True if it has points only."""
        return not len(self.own.faces)

    @property
    def radii(self) -> Floats:
        """The radii (V,) of the spheres around vertices; zeros where there are faces."""
        return self.own.attributes["radius"] if self.is_cloud else np.zeros(len(self.mesh.vertices))

    @property
    def material(self) -> Points:
        """The positions (V, 3), scene units, that its vertices had in the undeformed subject.

        With exact placement it is exact until the surface at rest is renewed. From then on, and with other
        placements, a new vertex is taken to come from the midpoint of its parents.
        """
        return material_of(self.mesh)

    def with_moved_copies(self, displace: Callable[[Points], Points]) -> MeshFrame:
        """Return the frame with its rigid copies carried and turned by the map of a flow."""
        assert self.copies is not None, "only rigid copies move as a whole"
        reach = 0.5 * float(np.linalg.norm(self.own.vertices, axis=1).max())
        return replace(self, copies=self.copies.moved(reach, displace))

    def to_arrays(self) -> dict[str, AnyArray]:
        """Return the frame as named arrays, as ``numpy.savez(file, **arrays)`` takes them.

        vertices float64 (V, 3), faces int32 (F, 3), creases int32 (K, 2), `attribute:<name>` (V, …) and
        report (): a string of JSON. With seams also seams int32 (S, 2). With identities also births
        int64 (N, 3), identities () and unsorted (). With polygons also offsets int32 (P + 1,) and corners
        int32 (C,). With a control net also net int32 (4,): rows, columns, and 1 for each closed direction.
        Rigid copies are stored as one, with copies and starts, float64 (N, 3, 4): see `Placements`.

        They hold no frame number: a shot whose frames are moved, and another shot with the same motion, show
        the same surface at another number.
        """
        mesh, polygons = self.own, self.polygons
        arrays: dict[str, AnyArray] = {"vertices": mesh.vertices, "faces": mesh.faces, **mesh.tagged_edges}
        if polygons is not None:
            arrays |= {"offsets": polygons.offsets, "corners": polygons.corners}
        if self.births is not None:
            numbers = {"identities": np.array(self.identities), "unsorted": np.array(self.unsorted)}
            arrays |= {"births": self.births, **numbers}
        if self.lattice is not None:
            arrays["net"] = self.lattice.as_array()
        if self.copies is not None and self.starts is not None:
            arrays |= {COPIES: self.copies.matrices, STARTS: self.starts.matrices}
        arrays |= {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        return {**arrays, "report": np.array(json.dumps(self.report.as_data()))}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, AnyArray], number: int) -> MeshFrame:
        """Return frame `number` of these arrays, bit for bit. Raises UsageError for a missing name."""
        if missing := sorted({"vertices", "faces", "report"} - set(arrays)):
            raise UsageError(f"the arrays have no {' and no '.join(missing)}; they are not a stored frame")
        names = [name for name in arrays if name.startswith(_ATTRIBUTE)]
        attributes = {name.removeprefix(_ATTRIBUTE): arrays[name] for name in names}
        tagged = arrays.get("creases"), arrays.get("seams")
        mesh = TriangleMesh(arrays["vertices"], arrays["faces"], attributes, *tagged)
        return cls(
            number=number,
            own=mesh,
            report=FrameReport.from_data(json.loads(str(arrays["report"]))),
            polygons=_polygons(mesh, arrays),
            births=arrays.get("births"),
            identities=int(arrays.get("identities", 0)),
            unsorted=int(arrays.get("unsorted", 0)),
            lattice=_lattice(mesh, arrays),
            copies=Placements(arrays[COPIES]) if COPIES in arrays else None,
            starts=Placements(arrays[STARTS]) if COPIES in arrays else None,
        )


def _lattice(mesh: TriangleMesh, arrays: Mapping[str, AnyArray]) -> Lattice | None:
    """Return the layout of the control points, if the arrays hold one."""
    if "net" not in arrays:
        return None
    lattice = Lattice.from_array(arrays["net"])
    if len(lattice) != len(mesh.vertices):
        raise UsageError(f"a net of {len(lattice)} points has {len(mesh.vertices)}; it is not a stored frame")
    return lattice


def _polygons(mesh: TriangleMesh, arrays: Mapping[str, AnyArray]) -> PolygonMesh | None:
    """Return the polygons that the mesh was triangulated from, if the arrays hold their corners."""
    if "corners" not in arrays or "offsets" not in arrays:
        return None
    count = int(arrays["corners"].max()) + 1  # a surface has no vertex without a face
    attributes = {name: values[:count] for name, values in mesh.attributes.items()}
    return PolygonMesh.from_arrays(
        mesh.vertices[:count], arrays["offsets"], arrays["corners"], attributes, mesh.creases
    )


def descent(frames: Sequence[MeshFrame]) -> Ancestry:
    """Return how the vertices of the last of these frames descend from those of the first.

    frames  consecutive, none left out; of those in between only the births are read

    `descent(frames).mixed(frames[0].mesh.vertices)` are the positions that the present vertices would have
    had then; what moved since is their motion.

    Raises UsageError where frames are missing or identities are not kept.
    """
    numbers = [frame.number for frame in frames]
    if not numbers or numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise UsageError(f"frames {numbers} are not consecutive; give all from the first to the last")
    births: list[AnyArray] = []
    for frame in frames:
        if frame.births is None or IDENTITY not in frame.mesh.attributes:
            fact = f"frame {frame.number} has no identities, so the ancestors of its vertices are unknown"
            raise UsageError(f"{fact}; only method triangles keeps them")
        births.append(frame.births)
    now, then = (frame.mesh.attributes[IDENTITY] for frame in (frames[-1], frames[0]))
    return ancestry(now, then, np.concatenate(births))


MATERIAL = "material"
"""Vertex attribute (V, 3): the material position, where `rest` does not hold it.

With exact placement `rest` holds it until the surface at rest is renewed.
"""

Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)


def with_material(mesh: Mesh) -> Mesh:
    """Return the undeformed surface with its present positions as material positions."""
    return mesh.with_attributes(**{MATERIAL: mesh.vertices})


def material_of(mesh: TriangleMesh) -> Points:
    """Return the positions (V, 3), scene units, that a frame's vertices had in the undeformed subject.

    With exact placement it is exact until the surface at rest is renewed. From then on, and with other
    placements, a new vertex is taken to come from the midpoint of its parents.

    Raises UsageError where the mesh is not from a frame of a shot.
    """
    for name in (MATERIAL, REST):
        if name in mesh.attributes:
            return mesh.attributes[name]
    neither = f"neither vertex attribute {MATERIAL!r} nor {REST!r}"
    raise UsageError(f"the mesh has {neither}; it is not from a frame of a shot")


MAX_DISTANCE = 1.0  # frames: farther away another frame is nearer, and the surface has been resampled since


def mesh_at_subframe(motion: Motion, frame: MeshFrame, subframe: float) -> TriangleMesh:
    """Return the mesh of a frame moved to a sub-frame, as `moved_to_subframe` moves it."""
    return moved_to_subframe(motion, frame, subframe).mesh


def moved_to_subframe(motion: Motion, frame: MeshFrame, subframe: float) -> MeshFrame:
    """Return a frame moved to a sub-frame: 12.5 lies between the frames 12 and 13.

    Vertices and faces are those of `frame`, in their order, moved by the shot's flow for the exact time,
    speed curves included. At the next frame's time they are where the simulation has them before it
    resamples. An earlier time runs the flow backwards. Frames of animated models move along their velocities.

    Raises UsageError for a sub-frame more than MAX_DISTANCE from the frame, FrameError where the flow fails.
    """
    if not abs(subframe - frame.number) <= MAX_DISTANCE:
        fact = f"sub-frame {subframe:g} is more than a frame from frame {frame.number}"
        raise UsageError(f"{fact}; take a nearer frame")
    time, dt = motion.clock.between(frame.number, subframe)
    velocities = frame.own.attributes.get(VELOCITY)
    if velocities is not None:
        return replace(frame, own=_with_points(frame.own, frame.own.vertices + dt * velocities))
    flow = motion.limit_steps(motion.flow, frame.number + (subframe > frame.number))

    def displace(points: Points) -> Points:
        return checked_displacement(flow, points, time, dt, frame.number)

    if frame.copies is not None:
        return frame.with_moved_copies(displace)
    return replace(frame, own=_with_points(frame.own, displace(frame.own.vertices)))


def _with_points(mesh: TriangleMesh, points: Points) -> TriangleMesh:
    return TriangleMesh(points, mesh.faces, creases=mesh.creases)
