"""One mesh of a subject for all frames of a request, refined and, if that is asked for, reduced again.

Reducing leaves out births, the vertices of splits. The error of a birth is the largest distance of its vertex
from the middle of the edge that it splits, over all frames, in maximum edge lengths of each. A birth needs
its parents and the two corners opposite its edge, so their errors count at least as much as its own. Then
the births with the largest errors, replayed in order, find each edge that they split and both its faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from flowsculpt import TriangleMesh, UsageError
from flowsculpt.api.frames import (
    MeshFrame,
    RenderRequest,
    Shading,
    Store,
    StoredFiles,
    animate,
    key_of,
)
from flowsculpt.api.meshes import Floats, Indices, carried_normals
from flowsculpt.api.shots import Motion
from flowsculpt.pipeline.plugins.interchange.birth_values import raise_to_dependents
from flowsculpt.pipeline.plugins.interchange.carried_sequence import TOLERANCE, CarriedSequence
from flowsculpt.pipeline.plugins.interchange.exported_frame import (
    has_colours,
    rendered_surface,
    surface_recipe,
    texture_coordinates,
)
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh, Reduction
from flowsculpt.pipeline.plugins.interchange.refining import (
    KIND,
    UNIFY,
    Began,
    Refined,
    Refiner,
    carries_normals,
    stored_arrays,
)


class _Errors(NamedTuple):
    """Errors (V,) of vertices, in maximum edge lengths, and the frames where they are largest; of births."""

    errors: Floats
    frames: Indices


@dataclass(frozen=True, eq=False)
class Unification:
    """Settings of one mesh of a subject: frames, and number of vertices.

    request   of a shot with one subject, such as one of its `parts`
    vertices  the most vertices; None for as many as no edge is too long with
    until     the error up to which births are left out; None for none
    is_plain  True for the shape alone, without colours and texture coordinates
    tolerance, carry_from  of a sequence whose faces change, see `CarriedSequence`; None for its own

    Raises UsageError for a subject that has no one mesh for all frames, and for settings of other subjects.
    """

    request: RenderRequest
    store: Store
    vertices: int | None = None
    until: float | None = None
    is_plain: bool = False
    tolerance: float | None = None
    carry_from: int | None = None

    def __post_init__(self) -> None:
        is_reduced = self.vertices is not None or self.until is not None
        if self._carried is not None and is_reduced:
            raise UsageError(
                f"{self.name}: its files move it, with other faces in each frame, and such a mesh is not "
                "reduced; leave out --vertices and --until"
            )
        if self._carried is None and not (self.tolerance is None and self.carry_from is None):
            raise UsageError(
                f"{self.name} is not a sequence whose faces change; leave out --tolerance and --carry-from"
            )
        if not self._is_rigid and self._carried is None:
            _ = self._refiner  # raises before anything is computed

    @property
    def name(self) -> str:
        """The name of the shot in files, with that of its subject if it has several."""
        return self.request.motion_folders.part_name

    @cached_property
    def key(self) -> str:
        """The key of the mesh, known before it is computed."""
        shot = self.request.shot
        if self._carried is not None:
            key = self._carried.key
        else:
            key = self.request.keys.mesh(max(self.request.requested)) if self._is_rigid else self._refiner.key
        return key_of(
            UNIFY.recipe,
            key,
            *(self.request.requested, str(shot.rate), self.vertices, self.until),
            *([None] if self.is_plain else surface_recipe(shot)),
        )

    def missing(self) -> list[int]:
        """Return the frames that are not refined yet."""
        if self._carried is not None:
            return self._carried.missing()
        return [] if self._is_rigid else self._refiner.missing()

    def one_mesh(self, began: Began = lambda name, total: lambda: None) -> OneMesh:
        """Return the mesh; what is not stored is computed.

        Raises FrameError where the surface cannot be refined or carried (see `Refiner.refined` and
        `CarriedSequence.one_mesh`), and UsageError where fewer vertices are asked for than the subject has at
        rest.
        """
        if self._carried is not None:
            name = self.request.source.subject or self.request.name
            return self._colour(self._carried.one_mesh(name, self.key, began))
        rigid = self._rigid_copies
        start = len(rigid.rest) if rigid else self._refiner.vertices_at_rest
        if self.vertices is not None and self.vertices < start:
            raise UsageError(
                f"{self.name} has {start} vertices at rest, so one mesh of it cannot have {self.vertices}"
            )
        if rigid:
            return self._colour(rigid)
        refined = self._refiner.refined(began)
        kept, reduction = self._reduce(refined, began)
        surface, _ = refined.surface(kept)
        rows = np.concatenate([np.ones(len(refined.start.vertices), bool), kept])
        motion = self.request.shot.motion

        def points_at(number: int) -> Floats:
            return refined.points_at(number)[rows]

        def velocities_at(number: int) -> Floats:
            return _velocities(motion, number, points_at(number), surface)

        mesh = OneMesh.of(
            self.request.source.subject or self.request.name,
            *(self.request.requested, motion.rate, surface, self.key, points_at, velocities_at),
        )
        if carries_normals(motion):
            whole = surface if reduction is None else refined.surface()[0]
            mesh = replace(mesh, normals_at=lambda number: self._normals(refined, whole, number)[rows])
        mesh = replace(mesh, longest_at=lambda number: float(np.median(refined.lengths_at(number))))
        mesh = replace(mesh, reduction=reduction)
        return self._colour(mesh)

    @cached_property
    def _carried(self) -> CarriedSequence | None:
        if not CarriedSequence.is_of(self.request):
            return None
        tolerance = TOLERANCE if self.tolerance is None else self.tolerance
        return CarriedSequence(self.request, self.store, tolerance, self.carry_from)

    @property
    def _is_rigid(self) -> bool:
        return self.request.shot.motion.is_rigid

    @cached_property
    def rigid_frames(self) -> dict[int, MeshFrame]:
        """The requested frames of rigid copies, and the first one, by their numbers.

        They share one surface and hold 96 bytes for each copy, as long as nobody asks for their `mesh`.
        """
        motion, last = self.request.shot.motion, max(self.request.requested)
        numbers = {motion.frames.first, *self.request.requested}
        return {
            frame.number: frame
            for frame in takewhile(lambda frame: frame.number <= last, animate(motion))
            if frame.number in numbers
        }

    @cached_property
    def _rigid_copies(self) -> OneMesh | None:
        """The mesh of rigid copies, whose vertices are the same in all frames; None for other subjects."""
        if not self._is_rigid:
            return None
        motion, frames = self.request.shot.motion, self.rigid_frames
        first = frames[motion.frames.first]
        own = motion.thresholds_at(first.number).with_hard_edges(first.own)

        def points_at(number: int) -> Floats:
            copies = frames[number].copies
            assert copies is not None, "rigid copies have placements"
            return copies.points(frames[number].own.vertices)

        return OneMesh.of(
            *(
                self.request.source.subject,
                self.request.requested,
                motion.rate,
                replace(first, own=own).mesh,
                self.key,
            ),
            points_at=points_at,
            velocities_at=lambda number: Shading.vertex_motion(motion, frames[number]).velocity(),
        )

    @cached_property
    def _refiner(self) -> Refiner:
        return Refiner(self.request, self.store)

    def _normals(self, refined: Refined, whole: TriangleMesh, number: int) -> Floats:
        """Return the normals (V, 3) of a frame, carried from frame to frame from the last that is stored.

        They are zero at creases. Each frame's are stored, float32.
        """
        motion, first = self.request.shot.motion, self.request.shot.motion.frames.first
        keys = {n: key_of(self._refiner.key, "normals", n - first) for n in range(first, number + 1)}
        held = next((n for n in reversed(keys) if self.store.holds(KIND, keys[n])), None)
        if held is None:
            held, normals = first, refined.normals_at_rest(motion)
            normals[whole.creases.ravel()] = 0.0
        else:
            normals = stored_arrays(self.store, keys[held])["normals"].astype(np.float64)
        for n in range(held + 1, number + 1):
            step = motion.step_into(motion.flow, n)
            before, after = refined.points_at(n - 1), refined.points_at(n)
            carried = carried_normals(step.apply, before, after, normals).astype(np.float32)
            self.store.put(KIND, keys[n], StoredFiles.writer(keys[n], {"normals": carried}))
            normals = carried.astype(np.float64)
        return normals

    def _colour(self, mesh: OneMesh) -> OneMesh:
        """Return the mesh with colours, those of the first frame, and texture coordinates."""
        look, first = self.request.shot.picture.look, mesh.frames[0]
        if self.is_plain:
            return mesh
        paint = self.request.shot.motion.painted(mesh.rest, mesh.faces)
        mesh = replace(mesh, texture=texture_coordinates(look, mesh.rest, mesh.faces, paint))
        if not has_colours(look):
            return mesh
        frame = mesh.frame(first)
        normals = frame.normals[: len(mesh.rest)]
        surface = rendered_surface(frame.points, normals, mesh.faces, mesh.rest, frame.velocities)
        places = self.request.shot.motion.copy_places(look.pattern, mesh.rest)
        surface = replace(surface, attributes={**surface.attributes, **places})
        return replace(
            mesh,
            colours=look.vertex_colours(replace(surface, paint=paint)),
            paint=paint if look.is_of_model else None,
        )

    def _reduce(self, refined: Refined, began: Began) -> tuple[np.ndarray, Reduction | None]:
        """Return flags (N,) of the births to keep, and what is left out."""
        start, births = len(refined.start.vertices), len(refined.births)
        kept = np.ones(births, bool)
        if not births or (self.vertices is None and self.until is None):
            return kept, None
        own = self._errors(refined, began)
        needed = own.errors.copy()
        _, opposite = refined.surface()
        raise_to_dependents(refined.births, opposite, start, needed)
        order = np.argsort(-needed[start:], kind="stable")
        room = births if self.vertices is None else min(births, self.vertices - start)
        if self.until is not None:
            room = min(room, int(np.count_nonzero(needed[start:] >= self.until)))
        kept[order[room:]] = False
        left = start + np.flatnonzero(~kept)
        if not len(left):
            return kept, None
        worst = left[np.argmax(own.errors[left])]
        return kept, Reduction(start + births, float(own.errors[worst]), int(own.frames[worst]))

    def _errors(self, refined: Refined, began: Began) -> _Errors:
        """Return the errors of births in the frames requested, from the store or computed."""
        key = key_of(self._refiner.key, "errors", self.request.requested)
        if self.store.holds(KIND, key):
            named = stored_arrays(self.store, key)
            return _Errors(named["errors"], named["frames"])
        passed = began("measuring", len(self.request.requested))
        a, b = refined.births.T
        first = len(refined.start.vertices)
        errors, frames = np.zeros(first + len(a)), np.zeros(first + len(a), np.int32)
        for number in self.request.requested:
            points, longest = refined.points_at(number), refined.lengths_at(number)
            away = np.linalg.norm(points[first:] - 0.5 * (points[a] + points[b]), axis=1)
            away /= np.sqrt(longest[a] * longest[b])
            larger = away > errors[first:]
            errors[first:][larger], frames[first:][larger] = away[larger], number
            passed()
        found = _Errors(errors, frames)
        self.store.put(KIND, key, StoredFiles.writer(key, found._asdict()))
        return found


def _velocities(motion: Motion, number: int, points: Floats, surface: TriangleMesh) -> Floats:
    """Return the velocities (V, 3) of points at a frame, scene units per second."""
    frame = MeshFrame(number, TriangleMesh(points, surface.faces))
    return Shading.vertex_motion(motion, frame).velocity()
