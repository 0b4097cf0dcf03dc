"""The resampler of 1990: polyhedra with faces of any number of sides, sliced along the axes (P16-P22)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flowsculpt import FrameError, PolygonMesh, Thresholds, UsageError
from flowsculpt.api import PolygonReport, PolygonResampler
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import (
    OUTSIDE,
    Collapse,
    Cutting,
    LengthLimits,
    Polyhedron,
    PolyhedronEditor,
    inherited,
)
from flowsculpt.pipeline.plugins.polyhedra.subdivision import Collapser, Slicer

_ATTRIBUTE = "attribute."
_LARGEST = 1e150  # squares of larger coordinates overflow


class PolyhedralResampler(PolygonResampler):
    """A polyhedron in flow: move `vertices`, then call `resample()`, frame after frame.

    mesh         the first surface: finite, oriented, manifold; open or closed, its faces with any number of
                 sides, concave or not (MeshError otherwise)
    thresholds   length limits and hard angle, numbers or functions; may be replaced between frames
    cutting      "slice": all parallel cuts of an element at once (P18); "recurse": in two, and again
    collapse     "edges": collapse short edges (P9); "areas": collapse small faces (P22)

    Vertex attributes are carried along: a new vertex gets the mean of its parents' values, a merged one those
    of the end that stays (integers and flags are never mixed). Tagged edges stay tagged and hard (P31).
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
        self._surface, self._mesh = Polyhedron(mesh), mesh
        self._attributes, self._vertices = mesh.attributes, np.array(mesh.vertices)

    @property
    def vertices(self) -> Floats:
        """(V, 3) float64: write the moved positions into it. `resample` replaces the array."""
        return self._vertices

    @property
    def mesh(self) -> PolygonMesh:
        """The surface as a value: vertices in the order of `vertices`, faces in the resampler's own order."""
        offsets, corners, creases = self._mesh.offsets, self._mesh.corners, self._mesh.creases
        return PolygonMesh.from_arrays(self._vertices, offsets, corners, self._attributes, creases)

    def state(self) -> dict[str, np.ndarray]:
        """Return copies of all that later frames depend on; keep them by ``numpy.savez(file, **state)``."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        arrays = {"offsets": mesh.offsets, "corners": mesh.corners, "creases": mesh.creases}
        return {"vertices": mesh.vertices, **arrays, **named}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, np.ndarray],
        thresholds: Thresholds,
        cutting: Cutting = "slice",
        collapse: Collapse = "edges",
    ) -> PolyhedralResampler:
        """Resume from a `state`, with the same bits as without a stop. Unknown names are ignored."""
        missing = [name for name in ("vertices", "offsets", "corners") if name not in state]
        if missing:
            raise UsageError(f"the state has no {' and no '.join(missing)}; a run cannot resume from it")
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        surface = state["vertices"], state["offsets"], state["corners"]
        mesh = PolygonMesh.from_arrays(*surface, attributes, state.get("creases"))
        return cls(mesh, thresholds, cutting, collapse)

    def resample(self) -> PolygonReport:
        """Bring edges and faces within their limits, in place.

        Afterwards no edge is over the maximum, and no face extends farther than it along any axis.

        Raises FrameError where a vertex is not finite or the vertices would exceed the budget; the surface is
        then still sound.
        """
        if not (np.abs(self._vertices) < _LARGEST).all():
            sizes = np.abs(self._vertices).max(axis=1)
            worst = int(np.argmax(np.where(np.isnan(sizes), np.inf, sizes)))
            raise FrameError(
                f"vertex {worst} is at {self._vertices[worst]}, which is not finite or too far away; "
                "lower the flow's strength there or raise its substeps"
            )
        mesh = self.mesh
        self._surface.points = [(x, y, z) for x, y, z in mesh.vertices.tolist()]
        this_pass = _Pass(self._surface, mesh, self.thresholds)
        try:
            this_pass.subdivide(self.cutting)
            this_pass.unsubdivide(self.collapse)
        finally:
            self._mesh, kept = self._surface.renumber()
            self._attributes = inherited(mesh.attributes, this_pass.editor.inheritance, kept)
            self._vertices = np.array(self._mesh.vertices)
        return this_pass.report(self._mesh)


class _Pass:
    """One resample pass: its steps and counters."""

    def __init__(self, surface: Polyhedron, mesh: PolygonMesh, thresholds: Thresholds) -> None:
        self.limits = LengthLimits(thresholds, mesh)
        self.editor = PolyhedronEditor(surface, self.limits)
        self._surface, self._mesh = surface, mesh
        self._passes = self._too_long = 0
        self._refused: Mapping[str, int] = {}

    def subdivide(self, cutting: Cutting) -> None:
        """Split all edges, then cut all faces (P16), and repeat for the new ones, until none is too large."""
        slicer, editor = Slicer(self.editor, cutting), self.editor
        edges, faces = long_edges(self._surface, self.limits), wide_faces(self._mesh, self.limits)
        while edges or faces:
            done = editor.splits + editor.cuts
            slicer.edges(edges)
            faces, edges = slicer.faces(faces)
            self._passes += editor.splits + editor.cuts > done

    def unsubdivide(self, collapse: Collapse) -> None:
        """Remove what is too small: edges, or faces with all their edges."""
        collapser, shorts = Collapser(self.editor), short_edges(self._surface, self.limits)
        if collapse == "edges":
            collapser.edges(shorts)
        else:
            collapser.faces(range(len(self._surface.side)), shorts)
        self._refused = collapser.refused
        longs = long_edges(self._surface, self.limits)
        self._too_long = sum(self.editor.is_too_long(h) for h in longs)

    def report(self, mesh: PolygonMesh) -> PolygonReport:
        """Return what the pass did, and the state of the resulting mesh."""
        _, lengths, _ = _measure(self._surface, np.zeros(len(mesh.vertices)))
        editor = self.editor
        return PolygonReport(
            splits=editor.splits,
            collapses=editor.collapses,
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
            cuts=editor.cuts,
            average_sides=mesh.average_sides,
            widest=float(mesh.extents.max()),
        )


_SLACK = 1e-9  # array and list arithmetic may round differently; exact tests follow


def long_edges(surface: Polyhedron, limits: LengthLimits) -> list[int]:
    """Return the first half-edges of the edges over the maximum."""
    edges, lengths, longest = _measure(surface, limits.table[:, 0])
    return edges[lengths > (1 - _SLACK) * longest].tolist()


def short_edges(surface: Polyhedron, limits: LengthLimits) -> list[int]:
    """Return the first half-edges of the edges under the minimum."""
    edges, lengths, shortest = _measure(surface, limits.table[:, 1])
    return edges[lengths < (1 + _SLACK) * shortest].tolist()


def wide_faces(mesh: PolygonMesh, limits: LengthLimits) -> list[int]:
    """Return the faces whose bounding box is longer than the maximum."""
    largest = np.minimum.reduceat(limits.table[mesh.corners, 0], mesh.offsets[:-1])
    return np.flatnonzero(mesh.extents > (1 - _SLACK) * largest).tolist()


def _measure(surface: Polyhedron, limit: Floats) -> tuple[np.ndarray, Floats, Floats]:
    """Return first half-edges, lengths, and the geometric means of the limits at their ends."""
    ends = np.array(surface.origin).reshape(-1, 2)
    edges = np.flatnonzero(ends[:, 0] != OUTSIDE)
    points = np.array(surface.points)
    a, b = ends[edges].T
    return 2 * edges, np.linalg.norm(points[a] - points[b], axis=1), np.sqrt(limit[a] * limit[b])
