"""Of which vertices of an earlier frame those of a later one descend."""

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
    """How the vertices of the last of these frames descend from those of the first.

    frames  one after the other, none left out; of those between only the births are looked at

    `descent(frames).mixed(frames[0].mesh.vertices)` is where the present vertices would have been then, and
    what moved since is their motion.

    Raises UsageError where there are no frames or one is left out, and where identities are not kept.
    """
    numbers = [frame.number for frame in frames]
    if not numbers or numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise UsageError(f"frames {numbers} are not one after the other; give all from the first to the last")
    births = [_births(frame) for frame in frames]
    now, then = (frame.mesh.attributes[IDENTITY] for frame in (frames[-1], frames[0]))
    return ancestry(now, then, np.concatenate(births))


def _births(frame: MeshFrame) -> AnyArray:
    if frame.births is None or IDENTITY not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no identities, so nobody knows whose its vertices are; method "
            "polyhedra keeps none"
        )
    return frame.births


MATERIAL = "material"
"""The vertex attribute (V, 3) of those places, where `rest` does not tell them: with exact placement it does
until the surface at rest is renewed."""

Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)


def marked(mesh: Mesh) -> Mesh:
    """The undeformed surface, whose vertices from here on remember where they are now."""
    return mesh.with_attributes(**{MATERIAL: mesh.vertices})


def material_of(mesh: TriangleMesh) -> Points:
    """(V, 3) scene units: where the vertices of a frame of a shot were in its undeformed subject.

    With exact placement that is exact until the surface at rest is renewed. From then on, and with other
    placements, a new vertex is taken to come from the middle between its parents.

    Raises UsageError where the mesh is no frame of a shot.
    """
    for name in (MATERIAL, REST):
        if name in mesh.attributes:
            return mesh.attributes[name]
    raise UsageError(
        f"the mesh has neither vertex attribute {MATERIAL!r} nor {REST!r}; it is no frame of a shot"
    )


FURTHEST = 1.0
"""Frames: beyond, the surface has been resampled, and another frame is nearer."""


def at_moment(motion: Motion, frame: MeshFrame, moment: float) -> TriangleMesh:
    """The mesh of a frame, where the flow has it at a moment: 12.5 lies between the frames 12 and 13.

    The vertices and faces are those of `frame`, in their order, moved by the very flow for the exact time,
    speed curves included. At the moment of the next frame they are where the simulation has them before it
    resamples. A moment before the frame runs the flow backwards.

    Raises UsageError where the moment is more than FURTHEST from the frame, FrameError where the flow fails.
    """
    if not abs(moment - frame.number) <= FURTHEST:
        raise UsageError(
            f"moment {moment:g} is more than a frame from frame {frame.number}; take a nearer one"
        )
    time, dt = motion.clock.between(frame.number, moment)
    flow = motion.bounded(motion.flow, frame.number + (moment > frame.number))
    moved = checked_displacement(flow, frame.mesh.vertices, time, dt, frame.number)
    return TriangleMesh(moved, frame.mesh.faces, creases=frame.mesh.creases)
