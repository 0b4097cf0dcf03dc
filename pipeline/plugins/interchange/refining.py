"""Refine a surface at rest wherever a frame needs it, until no edge is too long in any frame.

Each sweep moves all vertices through the frames by the flow, as frames of meshes are moved, and splits the
edges that are too long then: longest first, as the resampler does, without collapsing or flipping others. A
new vertex lies on the smooth surface at rest, where exact placement puts it, and now where the flow has
carried that point. So the first sweep depends on earlier frames only. A vertex that a later frame needs may
show a bend in an earlier one that its edge had cut off: further sweeps carry the new vertices through the
frames before, and split there, until a sweep splits nothing.

Each frame of a sweep has its file in the store: births, and positions of the vertices that the sweeps before
had not carried there. All files of a frame together hold its points. The keys of the first sweep follow those
of mesh frames: after an edit at frame 60, the frames before it stay. A vertex has the number of its birth.

births   int32 (N, 2): the parents of each vertex born in the frame, in order
born     float64 (N, 6): their position and normal at rest
points   float64 (M, 3): positions in the frame
longest  float64 (V,), of the first sweep: maximum edge lengths at the vertices, where they vary. They are
         those of the surface as it is refined by then; later vertices have the mean of their parents
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from flowsculpt import FrameError, Thresholds, TriangleMesh, UsageError, vertex_normals
from flowsculpt.api import VertexBudgetError
from flowsculpt.api.flows import FlowMap
from flowsculpt.api.frames import PipelineStage, RenderRequest, Store, StoredFiles, key_of
from flowsculpt.api.meshes import Floats, Indices, RefinableSurface
from flowsculpt.api.shots import Motion
from flowsculpt.pipeline.plugins.interchange.birth_values import mix_births

KIND = "refined"
"""The kind of its files in the store."""

UNIFY = PipelineStage(
    "unify",
    version=1,
    packages=("numba", "numpy"),
    doing="refining",
    makes=KIND,
    reads=("simulate",),
    per_quality=False,
)

MOST_SWEEPS = 20
"""Sweeps after which a surface counts as one that cannot be refined; most take two or three."""


class _KnownLengths(Thresholds):
    """Maximum edge lengths (V,) that are known already."""

    def __init__(self, known: Floats, max_vertices: int) -> None:
        super().__init__(1.0, 0.0, 1.0, max_vertices)
        self.known: Floats
        object.__setattr__(self, "known", known)

    @property
    def active(self) -> bool:
        return True

    def fields(self, mesh: TriangleMesh) -> Floats:
        return np.column_stack([self.known, np.zeros_like(self.known), np.ones_like(self.known)])


Began = Callable[[str, int], Callable[[], None]]
"""Takes the name of a part of the work and its number of frames; returns what is called after each."""


class _Sweep(NamedTuple):
    """Result of one sweep.

    keys    of its files by frame
    counts  of the vertices whose points the files of a frame hold, those of earlier sweeps included
    """

    keys: dict[int, str]
    counts: dict[int, int]


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined surface: births (N, 2) on a surface at rest, in order, and the points of each frame.

    start       the surface at rest before, with its creases
    born        (N, 6) position and normal at rest of the births
    points_at   returns the points (V, 3) of a frame
    lengths_at  returns the maximum edge lengths (V,) of a frame; infinite where nothing is resampled
    """

    start: TriangleMesh
    births: Indices
    born: Floats
    points_at: Callable[[int], Floats]
    lengths_at: Callable[[int], Floats]

    def normals_at_rest(self, motion: Motion) -> Floats:
        """Return normals (V, 3) at rest: those of the analytic surface, if it is known."""
        if (analytic := motion.analytic_surface()) is not None:
            return analytic.normals(np.concatenate([self.start.vertices, self.born[:, :3]]))
        return np.concatenate([vertex_normals(self.start), self.born[:, 3:]])

    def surface(self, kept: np.ndarray | None = None) -> tuple[TriangleMesh, Indices]:
        """Return the refined surface at rest, and the corners (N, 2) opposite the births' edges.

        kept  flags (N,) of births: those that all kept ones need must be among them
        """
        births, rest = self.births, self.born
        if kept is not None:
            numbers = np.cumsum(np.concatenate([np.ones(len(self.start.vertices), bool), kept])) - 1
            births, rest = numbers[births[kept]].astype(np.int32), rest[kept]
        surface = RefinableSurface(self.start)
        opposite = surface.replay(births, rest)
        return surface.mesh(), opposite


class Refiner:
    """Refines the surface of a subject for the frames up to the last one requested.

    Raises UsageError for a subject that has no such surface.
    """

    def __init__(self, request: RenderRequest, store: Store) -> None:
        self._request, self._store = request, store
        self._motion = request.shot.motion
        require_surface(request)
        first = self._motion.frames.first
        self.frames = range(first, max(request.requested) + 1)

    @cached_property
    def key(self) -> str:
        """The key of the refined surface."""
        return self._first_keys[self.frames[-1]]

    @cached_property
    def _first_keys(self) -> dict[int, str]:
        return {n: key_of(UNIFY.recipe, self._request.keys.mesh(n)) for n in self.frames}

    @property
    def vertices_at_rest(self) -> int:
        """The number of vertices before any edge is split."""
        return len(self._start.vertices)

    def missing(self) -> list[int]:
        """Return the frames whose files of the first sweep are not stored."""
        return [n for n in self.frames if not self._store.holds(KIND, self._first_keys[n])]

    def refined(self, began: Began = lambda name, total: lambda: None) -> Refined:
        """Return the refined surface; what is not stored is computed.

        Raises FrameError where the flow fails or tears the surface, where it does not move each point
        independently, or where the vertices exceed the budget.
        """
        sweeps: list[_Sweep] = []
        births, born = [np.empty((0, 2), np.int32)], [np.empty((0, 6))]
        keys = self._first_keys
        while True:
            sweep, before = _Sweep(keys, {}), len(births)
            name = f"{UNIFY.doing} {len(sweeps) + 1}" if sweeps else UNIFY.doing
            self._swept(sweep, sweeps, births, born, began(name, len(self.frames)))
            sweeps.append(sweep)
            if not any(map(len, births[before:])):
                break
            if len(sweeps) == MOST_SWEEPS:
                raise FrameError(
                    f"after {MOST_SWEEPS} sweeps through the frames some edges are still too long in some; "
                    "choose fewer frames, or a larger max_edge_length"
                )
            keys = {n: key_of(sweep.keys[self.frames[-1]], n - self.frames[0]) for n in self.frames}
        return Refined(
            *(self._start, np.concatenate(births), np.concatenate(born)),
            partial(self._points, sweeps),
            lambda number: self._lengths(sweeps[0], number, births),
        )

    def _lengths(self, first: _Sweep, number: int, births: Sequence[Indices]) -> Floats:
        """Return the maximum edge lengths (V,) of a frame at all vertices."""
        resampling = self._motion.resampling_at(number)
        if resampling is not None and resampling.thresholds.active:
            return self._known(first, number, births)
        longest = math.inf if resampling is None else resampling.thresholds.numbers[0]
        return np.full(len(self._start.vertices) + sum(map(len, births)), longest)

    def _swept(
        self,
        sweep: _Sweep,
        before: Sequence[_Sweep],
        births: list[Indices],
        born: list[Floats],
        passed: Callable[[], None],
    ) -> None:
        """Carry, split and store frame after frame; add births to the lists, and counts to the sweep."""
        surface: RefinableSurface | None = None
        known, points = 0, self._rest(born)  # of the vertices from the number `known` on
        for number in self.frames:
            held, key = before[-1].counts[number] if before else 0, sweep.keys[number]
            if surface is None and self._store.holds(KIND, key):
                entry = stored_arrays(self._store, key)
            else:
                if surface is None:
                    surface, history = RefinableSurface(self._start), self._history(number - 1)
                    surface.replay(np.concatenate(births), np.concatenate(born))
                points = self._step(points[held - known :], number, held, history)
                surface.points[:] = np.concatenate([self._points(before, number), points])
                limits = self._limits(surface, before, number, births)
                entry = self._split(surface, number, history, held, limits)
                self._store.put(KIND, key, StoredFiles.writer(key, entry))
            known, points = held, entry["points"]
            births.append(entry["births"])
            born.append(entry["born"])
            sweep.counts[number] = held + len(points)
            passed()

    def _history(self, last: int) -> FlowMap:
        """Return the flow from the first frame to `last`."""
        history = FlowMap()
        for number in range(self.frames[0] + 1, last + 1):
            history.add(self._motion.step_into(self._motion.flow, number))
        return history

    def _step(self, points: Floats, number: int, first: int, history: FlowMap) -> Floats:
        """Return points of the frame before moved into a frame, and add the step to the history.

        Raises FrameError where a point alone moves elsewhere than together with others.
        """
        if number == self.frames[0]:
            return points
        step = self._motion.step_into(self._motion.flow, number)
        history.add(step)
        moved = points.copy()
        step.move(moved, first)
        for one in {0, len(points) // 2, len(points) - 1} if len(points) > 1 else ():
            if not np.array_equal(step.apply(points[one : one + 1], first + one)[0], moved[one]):
                raise FrameError(
                    f"flow {step.flow.name} moves a point alone elsewhere than among others, so vertices of "
                    "later frames have no place here; let it move each point by itself",
                    number,
                )
        return moved

    def _limits(
        self, surface: RefinableSurface, sweeps: Sequence[_Sweep], number: int, births: Sequence[Indices]
    ) -> Thresholds | None:
        """Return the thresholds of a frame; lengths that vary are known, from the first sweep on."""
        resampling = self._motion.resampling_at(number)
        if resampling is None or not resampling.thresholds.active:
            return None if resampling is None else resampling.thresholds
        if sweeps:
            known = self._known(sweeps[0], number, births)
        else:
            known = resampling.thresholds.fields(_shown(surface.mesh(), self._motion))[:, 0]
        return _KnownLengths(known, resampling.thresholds.max_vertices)

    def _known(self, first: _Sweep, number: int, births: Sequence[Indices]) -> Floats:
        """Return the maximum edge lengths (V,) that the first sweep has found for a frame."""
        return self._mix(stored_arrays(self._store, first.keys[number])["longest"], births)

    def _mix(self, values: Floats, births: Sequence[Indices]) -> Floats:
        """Return values (U,) of the first vertices, and those of all births since, mixed from parents."""
        all_births, first = np.concatenate(births), len(self._start.vertices)
        mixed = np.empty(first + len(all_births))
        mixed[: len(values)] = values
        mix_births(np.ascontiguousarray(all_births[len(values) - first :]), len(values), mixed)
        return mixed

    def _split(
        self, surface: RefinableSurface, number: int, history: FlowMap, held: int, limits: Thresholds | None
    ) -> dict[str, np.ndarray]:
        """Split the edges that are too long in a frame; return the arrays of its file."""
        try:
            births = surface.split(limits, history.carry, self._motion.analytic_surface())
        except VertexBudgetError as error:
            raise FrameError(
                f"{error.fact}, of one mesh for all frames up to here; raise max_vertices or "
                "max_edge_length, or choose frames before",
                number,
            ) from None
        except FrameError as error:
            raise error.of(number) from None
        points = surface.points[held:].copy()
        arrays: dict[str, np.ndarray] = {"births": births.parents, "born": births.rest, "points": points}
        return arrays if births.longest is None or held else {**arrays, "longest": births.longest}

    @cached_property
    def _start(self) -> TriangleMesh:
        """The subject at rest, with its creases."""
        motion, first = self._motion, self.frames[0]
        mesh, resampling = motion.mesh_at_rest(), motion.resampling_at(first)
        thresholds = motion.thresholds_at(first)
        if resampling is None:
            return thresholds.with_hard_edges(mesh)
        return resampling.tag_creases(mesh, thresholds.hard_angles(mesh))

    def _rest(self, born: Sequence[Floats]) -> Floats:
        """Return the positions (V, 3) at rest of the vertices born so far."""
        return np.concatenate([self._start.vertices, *(rows[:, :3] for rows in born)])

    def _points(self, sweeps: Sequence[_Sweep], number: int) -> Floats:
        """Return the points that sweeps have stored of a frame."""
        stored = (stored_arrays(self._store, sweep.keys[number])["points"] for sweep in sweeps)
        return np.concatenate([np.empty((0, 3)), *stored])


def stored_arrays(store: Store, key: str) -> dict[str, np.ndarray]:
    """Return the arrays of a file of KIND. Raises FrameError where it is damaged."""
    place = store.path(KIND, key).relative_to(store.root)
    return store.read(KIND, key, place, StoredFiles(KIND).reader(key))


def _shown(mesh: TriangleMesh, motion: Motion) -> TriangleMesh:
    """Return the present surface as functions of edge length take it, with smooth normals as frames have."""
    if not carries_normals(motion):
        return mesh
    normals = vertex_normals(mesh)
    normals[mesh.creases.ravel()] = 0.0
    return mesh.with_attributes(normal=normals)


def carries_normals(motion: Motion) -> bool:
    """Tell whether normals of frames are carried through the flow."""
    resampling = motion.resampling
    return resampling is not None and (resampling.placement, resampling.normals) == ("exact", "carried")


def require_surface(request: RenderRequest) -> None:
    """Raise UsageError for a subject that has no one mesh for all frames."""
    motion = request.shot.motion
    resampling, name = motion.resampling, request.motion_folders.part_name
    if not motion.subject.is_surface:
        raise UsageError(f"{name}: points and control nets have no triangles to refine; export usd instead")
    if motion.animated is not None and motion.without_animation.flow.members:
        raise UsageError(
            f"{name}: its files move it under flows, and one mesh for all frames follows one of the two; "
            "export ply, obj or usd, which write each frame"
        )
    if resampling is not None and resampling.method == "polyhedra":
        raise UsageError(
            f"{name}: resample.method polyhedra cuts other faces in each frame; write method: triangles"
        )
    if resampling is not None and resampling.placement == "chord":
        raise UsageError(
            f"{name}: resample.placement chord puts new vertices beside the surface that the flow carries; "
            "write placement: exact"
        )
