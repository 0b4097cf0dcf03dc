"""The resampler as it was in 1990: polyhedra of any faces, sliced along the axes (P16-P22)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.errors import FrameError, UsageError
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.resample.polyhedra.collapse import Collapser
from pipeline.resample.polyhedra.length_limits import Bracket
from pipeline.resample.polyhedra.polyhedron import OUTSIDE, Polyhedron
from pipeline.resample.polyhedra.report import PolyhedralReport
from pipeline.resample.polyhedra.slicing import Cutting, Slicer
from pipeline.resample.polyhedra.workpiece import Workpiece, inherited
from pipeline.resample.thresholds import Thresholds

Collapse = Literal["edges", "areas"]

_ATTRIBUTE = "attribute."
_LARGEST = 1e150  # beyond it squares leave the numbers


class PolyhedralResampler:
    """A polyhedron in flow: move `vertices`, then `resample()`, frame after frame.

    mesh         what to begin with: finite, oriented, manifold; open or closed, its faces with any number
                 of sides, concave or not (MeshError otherwise)
    thresholds   the bracket, numbers or functions; may be replaced between frames
    cutting      "slice": all parallel cuts of an element at once (P18); "recurse": in two, and again
    collapse     "edges": short edges go (P9); "areas": small faces go (P22)

    Vertex attributes go along: a new vertex gets the mean of its parents', a merged one the survivor's
    (integers and flags are never mixed). Tagged edges stay tagged and hard (P31).
    """

    def __init__(
        self,
        mesh: PolygonMesh,
        thresholds: Thresholds,
        cutting: Cutting = "slice",
        collapse: Collapse = "edges",
    ) -> None:
        if cutting not in ("slice", "recurse"):
            raise UsageError(f"cutting {cutting!r} is not known; use 'slice' or 'recurse'")
        if collapse not in ("edges", "areas"):
            raise UsageError(f"collapse {collapse!r} is not known; use 'edges' or 'areas'")
        self.thresholds = thresholds
        self.cutting: Cutting = cutting
        self.collapse: Collapse = collapse
        self._surface = Polyhedron(mesh)
        self._keep(mesh, mesh.attributes)

    @property
    def vertices(self) -> Points:
        """(V, 3) float64: write the moved positions into it. `resample` makes it another array."""
        return self._vertices

    @property
    def mesh(self) -> PolygonMesh:
        """The surface as a value, vertices in the order of `vertices`; that of faces is ours."""
        mesh = self._mesh
        return PolygonMesh.from_arrays(
            self._vertices, mesh.offsets, mesh.corners, mesh.attributes, mesh.creases
        )

    def state(self) -> dict[str, AnyArray]:
        """Copies of all that the next frames depend on, by name: ``numpy.savez(file, **state)`` keeps it."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        arrays = {"offsets": mesh.offsets, "corners": mesh.corners, "creases": mesh.creases}
        return {"vertices": mesh.vertices, **arrays, **named}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, AnyArray],
        thresholds: Thresholds,
        cutting: Cutting = "slice",
        collapse: Collapse = "edges",
    ) -> PolyhedralResampler:
        """Go on from a `state`, bit for bit as if never stopped. Names it does not know are left alone."""
        missing = [name for name in ("vertices", "offsets", "corners") if name not in state]
        if missing:
            raise UsageError(f"the state holds no {' and no '.join(missing)}; it cannot be resumed from")
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        creases = state.get("creases")
        mesh = PolygonMesh.from_arrays(
            state["vertices"], state["offsets"], state["corners"], attributes, creases
        )
        return cls(mesh, thresholds, cutting, collapse)

    def resample(self) -> PolyhedralReport:
        """Bring edges and faces into the bracket again, in place.

        Afterwards no edge is over the maximum, and no face reaches farther than it along any axis.

        Raises FrameError where a vertex is not finite or the budget of vertices does not suffice; the
        surface is then still a sound one.
        """
        self._require_numbers()
        mesh = self.mesh
        self._surface.points = [(x, y, z) for x, y, z in mesh.vertices.tolist()]
        frame = _Frame(self._surface, mesh, self.thresholds)
        try:
            frame.subdivide(self.cutting)
            frame.unsubdivide(self.collapse)
        finally:
            after, kept = self._surface.renumber()
            self._keep(after, inherited(mesh.attributes, frame.piece.lineage, kept))
        return frame.report(after)

    def _keep(self, mesh: PolygonMesh, attributes: Mapping[str, AnyArray]) -> None:
        self._mesh = PolygonMesh.from_arrays(
            mesh.vertices, mesh.offsets, mesh.corners, attributes, mesh.creases
        )
        self._vertices = np.array(mesh.vertices)

    def _require_numbers(self) -> None:
        sound = (np.abs(self._vertices) < _LARGEST).all(axis=1)
        if not sound.all():
            wild = int(np.argmin(sound))
            raise FrameError(
                f"vertex {wild} has left the numbers: {self._vertices[wild]}; calm the flow there"
            )


class _Frame:
    """One resampling: its steps and counters."""

    def __init__(self, surface: Polyhedron, mesh: PolygonMesh, thresholds: Thresholds) -> None:
        self.bracket = Bracket(thresholds, mesh)
        self.piece = Workpiece(surface, self.bracket)
        self._surface, self._mesh = surface, mesh
        self._passes = self._too_long = 0
        self._refused: Mapping[str, int] = {}

    def subdivide(self, cutting: Cutting) -> None:
        """All edges, then all faces (P16), and again those that have been made, until none is too large."""
        slicer, piece = Slicer(self.piece, cutting), self.piece
        edges, faces = long_edges(self._surface, self.bracket), wide_faces(self._mesh, self.bracket)
        while edges or faces:
            done = piece.splits + piece.cuts
            slicer.edges(edges)
            faces, edges = slicer.faces(faces)
            self._passes += piece.splits + piece.cuts > done

    def unsubdivide(self, collapse: Collapse) -> None:
        """Remove what is too small: edges, or faces with all their edges."""
        collapser, shorts = Collapser(self.piece), short_edges(self._surface, self.bracket)
        if collapse == "edges":
            collapser.edges(shorts)
        else:
            collapser.faces(range(len(self._surface.side)), shorts)
        self._refused = collapser.refused
        longs = long_edges(self._surface, self.bracket)
        self._too_long = sum(self.piece.too_long(h) for h in longs)

    def report(self, mesh: PolygonMesh) -> PolyhedralReport:
        """What has been done, and how the mesh is that it left."""
        lengths, piece = edge_lengths(self._surface), self.piece
        return PolyhedralReport(
            splits=piece.splits,
            collapses=piece.collapses,
            flips=0,
            passes=self._passes,
            vertices=len(mesh.vertices),
            faces=len(mesh),
            edges=len(lengths),
            too_long=self._too_long,
            too_short=sum(self._refused.values()),
            shortest=float(lengths.min()),
            longest=float(lengths.max()),
            refused=self._refused,
            cuts=piece.cuts,
            average_sides=mesh.average_sides,
            widest=float(mesh.extents.max()),
        )


_SLACK = 1e-9


def long_edges(surface: Polyhedron, bracket: Bracket) -> list[int]:
    """The first half-edges of the edges over the maximum."""
    edges, lengths, limits = _measured(surface, bracket.table[:, 0])
    return _listed(edges[lengths > (1 - _SLACK) * limits])


def short_edges(surface: Polyhedron, bracket: Bracket) -> list[int]:
    """The first half-edges of the edges under the minimum."""
    edges, lengths, limits = _measured(surface, bracket.table[:, 1])
    return _listed(edges[lengths < (1 + _SLACK) * limits])


def wide_faces(mesh: PolygonMesh, bracket: Bracket) -> list[int]:
    """The faces whose box is longer than the maximum."""
    limits = np.minimum.reduceat(bracket.table[mesh.corners, 0], mesh.offsets[:-1])
    return _listed(np.flatnonzero(mesh.extents > (1 - _SLACK) * limits))


def edge_lengths(surface: Polyhedron) -> Floats:
    """(E,) of every edge, scene units."""
    return _measured(surface, np.zeros(len(surface.points)))[1]


def _measured(surface: Polyhedron, limit: Floats) -> tuple[AnyArray, Floats, Floats]:
    """First half-edges, lengths, and the limits that those of their two ends make together."""
    ends = np.array(surface.origin).reshape(-1, 2)
    edges = np.flatnonzero(ends[:, 0] != OUTSIDE)
    points = np.array(surface.points)
    a, b = ends[edges].T
    return 2 * edges, np.linalg.norm(points[a] - points[b], axis=1), np.sqrt(limit[a] * limit[b])


def _listed(numbers: AnyArray) -> list[int]:
    found: list[int] = numbers.tolist()
    return found
