"""Queries on frames: ancestors of vertices, material positions, and the surface between two frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from pipeline.animation.frame import MeshFrame
from pipeline.arrays import AnyArray, Points
from pipeline.errors import UsageError
from pipeline.flow import checked_displacement
from pipeline.mesh import PolygonMesh, TriangleMesh
from pipeline.mesh.identity import IDENTITY, Ancestry, ancestry
from pipeline.resample.placement.rest_surface import REST
from pipeline.shot import Motion


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
    births = [_births(frame) for frame in frames]
    now, then = (frame.mesh.attributes[IDENTITY] for frame in (frames[-1], frames[0]))
    return ancestry(now, then, np.concatenate(births))


def _births(frame: MeshFrame) -> AnyArray:
    if frame.births is None or IDENTITY not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no identities, so the ancestors of its vertices are unknown; method "
            "polyhedra keeps none"
        )
    return frame.births


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
    raise UsageError(
        f"the mesh has neither vertex attribute {MATERIAL!r} nor {REST!r}; it is not from a frame of a shot"
    )


MAX_DISTANCE = 1.0
"""Frames: farther away another frame is nearer, and the surface has been resampled since."""


def mesh_at_subframe(motion: Motion, frame: MeshFrame, subframe: float) -> TriangleMesh:
    """Return the mesh of a frame moved to a sub-frame: 12.5 lies between the frames 12 and 13.

    Vertices and faces are those of `frame`, in their order, moved by the shot's flow for the exact time,
    speed curves included. At the next frame's time they are where the simulation has them before it
    resamples. An earlier time runs the flow backwards.

    Raises UsageError for a sub-frame more than MAX_DISTANCE from the frame, FrameError where the flow fails.
    """
    if not abs(subframe - frame.number) <= MAX_DISTANCE:
        raise UsageError(
            f"sub-frame {subframe:g} is more than a frame from frame {frame.number}; take a nearer frame"
        )
    time, dt = motion.clock.between(frame.number, subframe)
    flow = motion.limit_steps(motion.flow, frame.number + (subframe > frame.number))
    moved = checked_displacement(flow, frame.mesh.vertices, time, dt, frame.number)
    return TriangleMesh(moved, frame.mesh.faces, creases=frame.mesh.creases)
