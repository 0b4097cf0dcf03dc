"""The adaptive resampler: split long edges and collapse short ones, once a frame.

Reynolds, *Adaptive Polyhedral Resampling for Vertex Flow Animation* (1991), the deltahedral version. It
reads the geometry of one frame only and knows nothing of the flow (P2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from pipeline.arrays import AnyArray, Points, Vectors
from pipeline.errors import UsageError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh, Register
from pipeline.mesh.meshes import TriangleMesh, morton_order
from pipeline.resample.placement import Chord, Curved, Placement
from pipeline.resample.quadrisection import quadrisect
from pipeline.resample.report import Report
from pipeline.resample.resample_pass import ResamplePass, changes_of, forget_rest, reset
from pipeline.resample.thresholds import DEFAULT_ROUNDNESS, Thresholds, TriangleShape

Splits = Literal["edges", "faces"]

_CHORD = Chord()

STATELESS: Mapping[str, Placement] = {"chord": _CHORD, "curved": Curved()}
"""Placements that keep nothing at the vertices, by name."""

_ATTRIBUTE = "attribute."
_GIVEN, _UNSORTED = "identities", "unsorted"
_CACHED = 50_000  # faces that fit into a core's own cache, where order does not matter
_NEW_SHARE = 1 / 3  # of the vertices of a large surface: with more new ones all are sorted again


class Resampler:
    """A surface in flow: move `vertices`, then call `resample()`, frame after frame.

    mesh           the first surface: finite, oriented, manifold; open or closed (MeshError otherwise)
    thresholds     length limits and hard angle; may be replaced between frames
    placement      where new vertices go
    min_roundness  triangles below it are improved (see `TriangleShape`)
    splits         "edges": cut long edges in two (P25); "faces": cut faces with a long edge into four (P26),
                   for new vertices on the chord only (UsageError otherwise)

    Vertex attributes are carried along: a new vertex gets the mean of its parents' values, a merged one those
    of the end that stays (integers and flags are never mixed). If the mesh has an attribute `identity`, a
    different int64 for every vertex, a new vertex gets a number never used before, and `births` names its
    parents.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> None:
        self._configure(thresholds, placement, min_roundness, splits)
        mesh = in_memory_order(placement.prepare(mesh, thresholds.hard_angles(mesh)))
        self._mesh = HalfedgeMesh(mesh, Register.of(mesh))
        self._unsorted = len(mesh.vertices)
        reset(changes_of(self._mesh))  # allocates the memory now, so that no frame waits for it

    def _configure(
        self, thresholds: Thresholds, placement: Placement, min_roundness: float, splits: Splits
    ) -> None:
        if splits not in ("edges", "faces"):
            raise UsageError(f"splits {splits!r} is not known; use 'edges' or 'faces'")
        if splits == "faces" and placement.leaves_chord:
            raise UsageError(
                "splits 'faces' puts new vertices in the middle of their edges, and "
                f"{type(placement).__name__} elsewhere; use Chord(), or split edges"
            )
        self.thresholds, self.placement, self.shape = thresholds, placement, TriangleShape(min_roundness)
        self.splits: Splits = splits

    @property
    def vertices(self) -> Points:
        """(V, 3) float64 view: write the moved positions into it. `resample` replaces the array."""
        return self._mesh.vertices

    def vectors(self, name: str) -> Vectors | None:
        """Return a (V, 3) float64 view of a vector attribute, to write into like `vertices`, or None."""
        column = self._mesh.column(name)
        attributes = self._mesh.arrays.attributes[: self._mesh.sizes[0]]
        return None if column is None else attributes[:, column : column + 3]

    def set_attributes(self, **named: AnyArray) -> None:
        """Replace vertex attributes by others of the same shape and type, or add them behind the rest."""
        self._mesh.set_attributes(named)
        forget_rest(self._mesh)

    @property
    def mesh(self) -> TriangleMesh:
        """The surface as a value: vertices in the order of `vertices`, faces in the resampler's own order."""
        return self._mesh.snapshot()

    @property
    def bare_mesh(self) -> TriangleMesh:
        """The surface as a value without its attributes and creases, which takes less memory."""
        return TriangleMesh(self._mesh.vertices, self._mesh.faces)

    @property
    def births(self) -> AnyArray | None:
        """int64 (N, 3) of the last `resample`, in order: the identities of each new vertex and its parents.

        Includes vertices that have collapsed again. None if the mesh has no identities.
        """
        return None if self._mesh.register is None else self._mesh.register.births

    @property
    def identities(self) -> int:
        """The number of identities given since the first frame; the next new vertex gets this number."""
        return 0 if self._mesh.register is None else self._mesh.register.given

    @property
    def unsorted(self) -> int:
        """The number of vertices born since the vertices were last sorted; at first that of all vertices."""
        return self._unsorted

    def state(self) -> dict[str, AnyArray]:
        """Return copies of all that later frames depend on; keep them by ``numpy.savez(file, **state)``."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        given = {} if self._mesh.register is None else {_GIVEN: np.array(self.identities)}
        surface = {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases}
        return {**surface, **named, **given, _UNSORTED: np.array(self._unsorted)}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, AnyArray],
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> Resampler:
        """Resume from a `state`, with the same bits as without a stop. Unknown names are ignored."""
        missing = {"vertices", "faces"} - set(state)
        if missing:
            raise UsageError(
                f"the state has no {' and no '.join(sorted(missing))}; a run cannot resume from it"
            )
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        resumed = cls.__new__(cls)  # without __init__, which may reorder faces
        resumed._configure(thresholds, placement, min_roundness, splits)
        mesh = TriangleMesh(state["vertices"], state["faces"], attributes, state.get("creases"))
        resumed._mesh = HalfedgeMesh(mesh, Register.of(mesh, int(state.get(_GIVEN, 0))))
        resumed._unsorted = int(state.get(_UNSORTED, 0))
        reset(changes_of(resumed._mesh))
        return resumed

    def resample(self) -> Report:
        """Bring the edges within their length limits, in place.

        Raises FrameError where a vertex is not finite or the vertices would exceed the budget; the surface is
        then still sound. Ctrl-C ends it at once and leaves the surface unusable.
        """
        report = self._resample()
        self._unsorted += report.splits
        if report.faces > _CACHED and self._unsorted > _NEW_SHARE * report.vertices:
            self._mesh.reorder(morton_order(self.vertices))
            self._unsorted = 0
        return report

    def _resample(self) -> Report:
        if self._mesh.register is not None:
            self._mesh.register.begin()
        this_pass = self._pass(self.thresholds)
        self.placement.restore(self._mesh, this_pass.limits)
        this_pass.find_edges()
        if self.splits == "edges" or not this_pass.long_edges[0]:
            return this_pass.run()
        mesh, thresholds, parents, rounds = quadrisect(self._mesh.snapshot(), self.thresholds)
        self._mesh = HalfedgeMesh(mesh, self._mesh.register)
        self._mesh.enter_births(parents)
        this_pass = self._pass(thresholds)
        this_pass.find_edges()
        report = this_pass.run()
        return replace(report, splits=report.splits + len(parents), passes=report.passes + rounds)

    def _pass(self, thresholds: Thresholds) -> ResamplePass:
        return ResamplePass(self._mesh, thresholds, self.placement, self.shape)


def resample(
    mesh: TriangleMesh,
    thresholds: Thresholds,
    placement: Placement = _CHORD,
    min_roundness: float = DEFAULT_ROUNDNESS,
    splits: Splits = "edges",
) -> tuple[TriangleMesh, Report]:
    """Resample one mesh once. For a film keep a `Resampler`, which keeps the connectivity."""
    resampler = Resampler(mesh, thresholds, placement, min_roundness, splits)
    report = resampler.resample()
    return resampler.mesh, report


def in_memory_order(mesh: TriangleMesh) -> TriangleMesh:
    """Return the same surface; faces of a large one are sorted by their lowest vertex.

    Vertices keep their numbers until they are resampled, since the caller may know them by number. A pass
    over a million faces in random order takes several times as long as one in memory order.
    """
    if len(mesh.faces) <= _CACHED:
        return mesh
    order = np.argsort(mesh.faces.min(axis=1), kind="stable")
    return TriangleMesh(mesh.vertices, mesh.faces[order], mesh.attributes, mesh.creases)
