"""The adaptive resampler: split what is too long, collapse what is too short, once a frame.

Reynolds, *Adaptive Polyhedral Resampling for Vertex Flow Animation* (1991), the deltahedral version.
It looks at the geometry of one moment only and knows nothing of what moved it (P2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from pipeline.arrays import AnyArray, Points, Vectors
from pipeline.errors import UsageError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.identity import Register
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.resample.placement.base import Chord, Placement
from pipeline.resample.quadrisection import quarter
from pipeline.resample.report import Report
from pipeline.resample.resample_pass import Frame, changes_of, wipe
from pipeline.resample.thresholds import Thresholds
from pipeline.resample.triangle_shape import DEFAULT_ROUNDNESS, Shape

Splits = Literal["edges", "faces"]

_CHORD = Chord()
_ATTRIBUTE = "attribute."
_GIVEN = "identities"


class Resampler:
    """A surface in flow: move `vertices`, then `resample()`, frame after frame.

    mesh         what to begin with: finite, oriented, manifold; open or closed (MeshError otherwise)
    thresholds   the bracket; may be replaced between frames
    placement    where new vertices go
    min_roundness  roundness below which triangles are mended (see `Shape`): 0 to 1
    splits       "edges": long edges are cut in two (P25); "faces": faces that have one into four (P26), which
                 is for new vertices on the chord (UsageError otherwise)

    Vertex attributes go along: a new vertex gets the mean of its parents', a merged one the survivor's
    (integers and flags are never mixed). Where the mesh has an attribute `identity`, a different int64 for
    every vertex, a new vertex gets one that no other has ever had, and `births` tells of whom it was born.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> None:
        self._settle(thresholds, placement, min_roundness, splits)
        begun = in_memory_order(placement.prepare(mesh, thresholds.hard_angles(mesh)))
        self._mesh = HalfedgeMesh(begun, Register.of(begun))
        wipe(changes_of(self._mesh))  # memory is claimed now, so that no frame waits for it

    def _settle(
        self, thresholds: Thresholds, placement: Placement, min_roundness: float, splits: Splits
    ) -> None:
        if splits not in ("edges", "faces"):
            raise UsageError(f"splits {splits!r} is not known; use 'edges' or 'faces'")
        if splits == "faces" and placement.leaves_chord:
            raise UsageError(
                "splits 'faces' puts new vertices in the middle of their edges, and "
                f"{type(placement).__name__} elsewhere; use Chord(), or split edges"
            )
        self.thresholds, self.placement, self.shape = thresholds, placement, Shape(min_roundness)
        self.splits: Splits = splits

    @property
    def vertices(self) -> Points:
        """(V, 3) float64 view: write the moved positions into it. `resample` makes it another array."""
        return self._mesh.vertices

    def vectors(self, name: str) -> Vectors | None:
        """(V, 3) float64 view of a vertex attribute of vectors, to write into like `vertices`, or None."""
        column = self._mesh.column(name)
        return (
            None if column is None else self._mesh.surface.carried[: self._mesh.sizes[0], column : column + 3]
        )

    @property
    def mesh(self) -> TriangleMesh:
        """The surface as a value, vertices in the order of `vertices`; that of faces is ours."""
        return self._mesh.snapshot()

    @property
    def births(self) -> AnyArray | None:
        """int64 (N, 3) of the last `resample`, in order of birth: the identity of each new vertex, even if it
        has collapsed again, and those of its parents. None where the mesh has no identities."""
        return None if self._mesh.register is None else self._mesh.register.births

    @property
    def identities(self) -> int:
        """How many identities have been given since the first frame: the next new vertex gets this one."""
        return 0 if self._mesh.register is None else self._mesh.register.given

    def state(self) -> dict[str, AnyArray]:
        """Copies of all that the next frames depend on, by name: ``numpy.savez(file, **state)`` keeps it."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        given = {} if self._mesh.register is None else {_GIVEN: np.array(self.identities)}
        return {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases, **named, **given}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, AnyArray],
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> Resampler:
        """Go on from a `state`, bit for bit as if never stopped. Names it does not know are left alone."""
        missing = {"vertices", "faces"} - set(state)
        if missing:
            raise UsageError(
                f"the state holds no {' and no '.join(sorted(missing))}; it cannot be resumed from"
            )
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        resumed = cls.__new__(cls)  # not by __init__, which may order faces anew
        resumed._settle(thresholds, placement, min_roundness, splits)
        mesh = TriangleMesh(state["vertices"], state["faces"], attributes, state.get("creases"))
        resumed._mesh = HalfedgeMesh(mesh, Register.of(mesh, int(state.get(_GIVEN, 0))))
        return resumed

    def resample(self) -> Report:
        """Bring the edges into the bracket again, in place.

        Raises FrameError where a vertex is not finite or the budget of vertices does not suffice; the
        surface is then still a sound one.
        """
        if self._mesh.register is not None:
            self._mesh.register.begin()
        frame = Frame(self._mesh, self.thresholds, self.placement, self.shape)
        self.placement.heal(self._mesh, frame.limits)
        frame.scan()
        if self.splits == "faces" and frame.longs[0]:
            return self._in_four()
        return _brought_back(frame)

    def _in_four(self) -> Report:
        """Cut faces, and see to short edges and shapes as ever."""
        mesh, thresholds, parents, passes = quarter(self._mesh.snapshot(), self.thresholds)
        self._mesh = HalfedgeMesh(mesh, self._mesh.register)
        self._mesh.enter_births(parents)
        frame = Frame(self._mesh, thresholds, self.placement, self.shape)
        frame.scan()
        done = _brought_back(frame)
        return replace(done, splits=done.splits + len(parents), passes=done.passes + passes)


def _brought_back(frame: Frame) -> Report:
    """The rest of a frame whose edges have been looked through."""
    frame.split_long_edges()
    frame.collapse_short_edges()
    return frame.report()


def resample(
    mesh: TriangleMesh,
    thresholds: Thresholds,
    placement: Placement = _CHORD,
    min_roundness: float = DEFAULT_ROUNDNESS,
    splits: Splits = "edges",
) -> tuple[TriangleMesh, Report]:
    """One resampling of one mesh; for a film keep a `Resampler`, which keeps the connectivity."""
    resampler = Resampler(mesh, thresholds, placement, min_roundness, splits)
    report = resampler.resample()
    return resampler.mesh, report


_CACHED = 50_000  # faces whose vertices and table fit into a core's own cache, where order does not matter


def in_memory_order(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface, its faces sorted by their lowest vertex if it is a large one.

    Vertices keep their numbers, since whoever moves them counts on it. A pass over a million faces that
    jump about among their vertices takes several times as long as one that walks along them.
    """
    if len(mesh.faces) <= _CACHED:
        return mesh
    order = np.argsort(mesh.faces.min(axis=1), kind="stable")
    return TriangleMesh(mesh.vertices, mesh.faces[order], mesh.attributes, mesh.creases)
