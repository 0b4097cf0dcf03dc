"""Rigid copies as a shape and its places: where each copy is, how it is turned, and its colour."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.frames import MeshFrame, Shading
from flowsculpt.api.meshes import Floats, Placements
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.unifying import Unification

REMEDY = "Leave out --instances"


class PlacedCopies(NamedTuple):
    """The copies of a frame, and their velocities (N, 3) and angular velocities (N, 3), per second."""

    placements: Placements
    velocities: Floats
    turning: Floats


@dataclass(frozen=True, eq=False)
class Instances:
    """The rigid copies of a subject: a shape in the place of its first copy at rest, without its size.

    shape    its mesh at its own origin
    colours  linear Rec.709 (N, 3) of the copies; None where they have one colour, or the shape has its own
    """

    mesh: OneMesh
    shape: OneMesh
    colours: Floats | None
    frames: dict[int, MeshFrame]
    unification: Unification

    @classmethod
    def of(cls, unification: Unification, began: Callable[[str, int], Callable[[], None]]) -> Instances:
        """Return the copies of a subject. Raises UsageError where patterns or pictures differ on them."""
        motion, numbers = unification.request.shot.motion, unification.request.requested
        mesh, frames = unification.one_mesh(began), unification.rigid_frames
        count = len(placed(frames[numbers[0]]))
        vertices, faces = len(mesh.rest) // count, mesh.faces[: len(mesh.faces) // count]
        corners = mesh.corner_normals[: len(faces)]

        def shared(values: np.ndarray | None) -> np.ndarray | None:
            """Return what the first copy has, if all have the same."""
            if values is None:
                return None
            rows = values.reshape(count, -1, *values.shape[1:])
            return rows[0] if np.allclose(rows, rows[:1], atol=1e-5) else None

        colours, texture = shared(mesh.colours), shared(mesh.texture)
        of_each = None
        if mesh.colours is not None and colours is None:
            rows = mesh.colours.reshape(count, vertices, 3)
            of_each = rows[:, 0] if np.allclose(rows, rows[:, :1], atol=1e-5) else None
        if mesh.paint is not None or (texture is None) != (mesh.texture is None):
            raise UsageError(
                f"{unification.name} has paint or pictures, which its copies do not share. {REMEDY}"
            )
        if mesh.colours is not None and colours is None and of_each is None:
            raise UsageError(f"{unification.name} has a pattern over all its copies. {REMEDY}")
        own = frames[motion.frames.first].own
        used = np.unique(corners)
        shape = replace(
            mesh,
            frames=(motion.frames.first,),
            faces=faces,
            corner_normals=np.searchsorted(used, corners).astype(np.int32),
            creases=mesh.creases[(mesh.creases < vertices).all(axis=1)],
            rest=own.vertices,
            points_at=lambda number: own.vertices,
            velocities_at=lambda number: np.zeros_like(own.vertices),
            colours=colours,
            texture=texture,
        )
        return cls(mesh, shape, of_each, frames, unification)

    def placements(self, number: int) -> Placements:
        """Return where the copies are at a frame."""
        return placed(self.frames[number])

    def at(self, number: int) -> PlacedCopies:
        """Return the copies of a frame."""
        frame = self.frames[number]
        placements = placed(frame)
        points = self.mesh.points_at(number).reshape(len(placements), -1, 3)
        moved = Shading.vertex_motion(self.unification.request.shot.motion, frame).velocity()
        return PlacedCopies(
            placements, *rigid_velocities(points, moved.reshape(points.shape), placements.origins)
        )


def require_rigid(parts: Iterable[Unification]) -> None:
    """Raise UsageError for a subject without rigid copies."""
    for part in parts:
        if not part.request.shot.motion.is_rigid:
            raise UsageError(f"{part.name} has no rigid copies (copies: {{rigid: true}}). {REMEDY}")


def placed(frame: MeshFrame) -> Placements:
    assert frame.copies is not None, "rigid copies have placements"
    return frame.copies


def rigid_velocities(points: np.ndarray, moved: np.ndarray, origins: Floats) -> tuple[Floats, Floats]:
    """Return velocities (N, 3) at origins (N, 3) and angular velocities (N, 3), radians, of rigid bodies.

    points, moved  vertices (N, V, 3) and their velocities

    They are those that differ least from the vertices' own.
    """
    middle, mean = points.mean(axis=1), moved.mean(axis=1)
    away, speed = points - middle[:, None], moved - mean[:, None]
    inertia = np.einsum("nvi,nvi->n", away, away)[:, None, None] * np.eye(3)
    inertia = inertia - np.einsum("nvi,nvj->nij", away, away)
    turning = np.linalg.solve(inertia, np.cross(away, speed).sum(axis=1)[..., None])[..., 0]
    return mean + np.cross(turning, origins - middle), turning
