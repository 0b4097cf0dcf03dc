"""One mesh of a sequence whose faces change: what is refused, and what is stored."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import groupby
from typing import NamedTuple

import numpy as np

from flowsculpt import FlowsculptError, FrameError, TriangleMesh, UsageError
from flowsculpt.api import plural
from flowsculpt.api.frames import FrameRange, RenderRequest, Store, StoredFiles, key_of
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.carrying import VERSION, Carrier, in_words
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import KIND, UNIFY, Began, stored_arrays
from flowsculpt.pipeline.plugins.interchange.shown_surfaces import ShownSurface, Topology

TOLERANCE = 0.25
"""The largest distance of the mesh and a file's surface, in median edges of that, by default."""

LEAST_AGREEMENT = 0.5
"""The cosine of the angle of a file's normal and that of the mesh from which on it is taken: in tight folds
triangles turn from the normal by more than those of files do."""

_KEPT = 4  # surfaces that are in memory in any case: those of a step

_MOST_KEPT = 1_000_000  # vertices of all surfaces in memory: about 0.5 GB


class _Refusal(NamedTuple):
    """Why no mesh follows the surfaces of some frames.

    frame       where it does not
    fact        why, in words
    near        frames that a mesh may follow
    carry_from  the frame that it then begins with; None for the middle one
    otherwise   remedies besides those frames, in words
    """

    frame: int
    fact: str
    near: list[int]
    carry_from: int | None
    otherwise: str


@dataclass(frozen=True, eq=False)
class CarriedSequence:
    """One mesh of a sequence whose faces change, for the frames requested and those between.

    tolerance   in median edges of each frame's surface
    carry_from  the frame whose surface is carried; None for the middle one

    Raises UsageError for a frame that is not among them.
    """

    request: RenderRequest
    store: Store
    tolerance: float = TOLERANCE
    carry_from: int | None = None

    def __post_init__(self) -> None:
        if self.carry_from is not None and self.carry_from not in self._numbers:
            raise UsageError(
                f"--carry-from {self.carry_from}: the frames are {_range(self._numbers)}. Choose one of "
                "these."
            )

    @staticmethod
    def is_of(request: RenderRequest) -> bool:
        """Tell whether the subject of a request is such a sequence."""
        animated = request.shot.motion.animated
        return animated is not None and not animated.model.keeps_faces

    @cached_property
    def key(self) -> str:
        """The key of the mesh, known before it is computed."""
        keys = [self.request.keys.mesh(number) for number in self._numbers]
        return key_of(UNIFY.recipe, "carried", VERSION, self.tolerance, self._start, keys)

    def missing(self) -> list[int]:
        """Return the frames through which the mesh is not carried yet."""
        return [n for n in self._numbers if not self.store.holds(KIND, self._frame_key(n))]

    def one_mesh(self, name: str, key: str, began: Began) -> OneMesh:
        """Return the mesh; what is not stored is computed.

        Raises FrameError, with the frame, the place and the remedy, where parts of the surface merge or
        split, or where the mesh is farther from a surface than the tolerance.
        """
        if self.missing() or not self.store.holds(KIND, self.key):
            self._carry(began)
        arrays, motion = stored_arrays(self.store, self.key), self.request.shot.motion
        mesh = TriangleMesh(arrays["vertices"], arrays["faces"], creases=arrays["creases"])
        whole = OneMesh.of(
            *(name, self.request.requested, motion.rate, mesh, key),
            points_at=partial(self._stored, "points"),
            velocities_at=self._velocities,
        )
        return replace(
            whole,
            normals_at=partial(self._stored, "normals"),
            least_agreement=LEAST_AGREEMENT,
            longest_at=lambda number: float(self._stored("edge", number)),
        )

    @property
    def _numbers(self) -> range:
        return range(min(self.request.requested), max(self.request.requested) + 1)

    @property
    def _start(self) -> int:
        return self._numbers[len(self._numbers) // 2] if self.carry_from is None else self.carry_from

    def _frame_key(self, number: int) -> str:
        return key_of(self.key, "frame", number - self._numbers[0])

    def _stored(self, kind: str, number: int) -> Floats:
        return stored_arrays(self.store, self._frame_key(number))[kind]

    def _carry(self, began: Began) -> None:
        """Compute the mesh and store it, if it follows all surfaces.

        Otherwise the mesh of fewer frames is computed and stored, so that a remedy is known to help: fewer
        frames are refined otherwise.
        """
        surface_of = _kept(self._surface)
        refusal = self._split_or_merged(surface_of, began) or self._follow(surface_of, began)
        if refusal is not None:
            options = self._of_fewer(refusal, surface_of, began)
            remedy = f"Choose {options}, which is carried already, or {refusal.otherwise}"
            raise FrameError(
                f"{refusal.fact}. {remedy if options else refusal.otherwise.capitalize()}", refusal.frame
            )

    def _of_fewer(
        self, refusal: _Refusal | None, surface_of: Callable[[int], ShownSurface], began: Began
    ) -> str:
        """Return the options for fewer frames, whose mesh is then stored; empty where there are none.

        Each attempt after the first has at most two thirds of the frames of the one before: all together cost
        no more than three of them.
        """
        most = math.inf
        while refusal is not None and len(near := _some(refusal, most)) > 1:
            most = math.ceil(len(near) * 2 / 3)
            requested = replace(self.request, requested=FrameRange.of(near))
            fewer = replace(self, request=requested, carry_from=refusal.carry_from)
            options = f"-f {_range(near)}"
            if fewer.carry_from is not None:
                options += f" --carry-from {fewer.carry_from}"
            try:
                refusal = fewer._follow(surface_of, began) if fewer.missing() else None
            except FrameError:
                return ""
            if refusal is None:
                return options
        return ""

    def _follow(self, surface_of: Callable[[int], ShownSurface], began: Began) -> _Refusal | None:
        """Carry the mesh through surfaces of one topology and store it, or return why it is refused."""
        start, frames = self._start, _range(self._numbers)
        budget = self.request.shot.motion.thresholds_at(start).max_vertices
        carrier = Carrier(surface_of, self._numbers, start, self.tolerance, budget)
        carried = carrier.carried(lambda name, count: began(f"{name} {frames}", count))
        is_near = {n for n, d in carried.deviations.items() if d.distance <= self.tolerance}
        if far := {*carried.deviations} - is_near:
            first = min(far, key=lambda number: abs(number - start))
            return _Refusal(
                first,
                f"the mesh of frame {start}, carried here, is "
                f"{in_words(carried.deviations[first], self.tolerance)}",
                _around(start, is_near),
                start,
                "try another frame's mesh by --carry-from, or a coarser --tolerance",
            )
        for number, places in carried.places.items():
            shown, key = surface_of(number), self._frame_key(number)
            arrays = {"points": places.points, "normals": shown.shading(places), "edge": np.array(shown.edge)}
            self.store.put(KIND, key, StoredFiles.writer(key, arrays))
        mesh = carried.mesh
        arrays = {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases}
        self.store.put(KIND, self.key, StoredFiles.writer(self.key, arrays))
        return None

    def _surface(self, number: int) -> ShownSurface:
        motion = self.request.shot.motion
        assert motion.animated is not None, "it is a sequence"
        try:
            mesh = motion.animated.mesh(number)
            angle = motion.thresholds_at(number).hard_angles(mesh)
            return ShownSurface(number, motion.clock.flow_time(number), mesh, float(np.mean(angle)))
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error

    def _split_or_merged(self, surface_of: Callable[[int], ShownSurface], began: Began) -> _Refusal | None:
        """Return where a frame has other parts, handles or rims than the one before; None for nowhere."""
        found, passed = dict[int, Topology](), began("reading", len(self._numbers))
        for number in self._numbers:
            found[number] = surface_of(number).topology(self.tolerance)
            passed()
        runs = [list(run) for _, run in groupby(self._numbers, key=found.__getitem__)]
        if len(runs) == 1:
            return None
        before, after = runs[0][-1], runs[1][0]
        step = Carrier(surface_of, range(before, after + 1), before, self.tolerance, 0).step()
        x, y, z = step.place
        longest = max(runs, key=len)
        return _Refusal(
            after,
            f"the surface merges or splits at ({x:.4g}, {y:.4g}, {z:.4g}): it has {_words(found[after])}, "
            f"and {_words(found[before])} in frame {before}, so no mesh for all frames follows it",
            longest,
            self.carry_from if self.carry_from in longest else None,
            "make two subjects of what is apart",
        )

    def _velocities(self, number: int) -> Floats:
        """Return the velocities (V, 3) of a frame, from its neighbours."""
        one, two = (n if n in self._numbers else number for n in (number - 1, number + 1))
        here, there = (self._stored("points", n) for n in (one, two))
        return (there - here) * (float(self.request.shot.motion.rate.fps) / max(two - one, 1))


def _kept(surface_of: Callable[[int], ShownSurface]) -> Callable[[int], ShownSurface]:
    """Return what keeps the first surfaces that are asked for in memory, as long as there is room."""
    latest, kept = lru_cache(_KEPT)(surface_of), dict[int, ShownSurface]()

    def surface(number: int) -> ShownSurface:
        if number in kept:
            return kept[number]
        found = latest(number)
        if sum(len(each.mesh.vertices) for each in kept.values()) < _MOST_KEPT:
            kept[number] = found
        return found

    return surface


def _around(start: int, numbers: set[int]) -> list[int]:
    """Return the numbers around one that are in a set, as far as they follow each other."""
    first = last = start
    while first - 1 in numbers:
        first -= 1
    while last + 1 in numbers:
        last += 1
    return list(range(first, last + 1))


def _some(refusal: _Refusal, most: float) -> list[int]:
    """Return up to so many of the frames that a mesh may follow, around the one that it begins with."""
    near, start = refusal.near, refusal.carry_from
    if len(near) <= most or start is None:
        return near
    first = min(max(start - int(most) // 2, near[0]), near[-1] + 1 - int(most))
    return list(range(first, first + int(most)))


def _range(numbers: range | list[int]) -> str:
    return f"{numbers[0]}-{numbers[-1]}"


def _words(found: Topology) -> str:
    counts = [plural(found.parts, "part"), plural(found.handles, "handle"), plural(found.rims, "rim")]
    return f"{counts[0]}, {counts[1]} and {counts[2]}"
