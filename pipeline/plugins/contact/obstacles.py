"""Other subjects that a subject gives way to: where they are at a time, and how high as seen from a side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt import FrameError
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.earlier_motion import SAMPLES, STEP, EarlierMotion, MovedPoints
from flowsculpt.pipeline.plugins.contact.heights import Heights

if TYPE_CHECKING:
    from flowsculpt.api.shots import Motion

FINENESS = 32
"""Edges of a solid along its longest side; models are as their files have them."""

RIGID = 1e-6
"""How far points may be from where a rigid motion takes them, in sizes of the subject."""

SIDES = np.concatenate([np.eye(3)[[1, 0, 2]], -np.eye(3)[[1, 0, 2]]])


def rigid_motion(rest: Floats, now: Floats) -> tuple[Floats, Floats] | None:
    """Return the turn (3, 3) and the shift (3,) that take points (N, 3) to others; None if no motion does.

    The turn is that of the least squares (Kabsch 1976).
    """
    left, _, right = np.linalg.svd((now - now.mean(axis=0)).T @ (rest - rest.mean(axis=0)))
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    turn = left @ right
    shift = now.mean(axis=0) - turn @ rest.mean(axis=0)
    apart = np.abs(rest @ turn.T + shift - now).max()
    return (turn, shift) if apart < RIGID * np.ptp(rest, axis=0).max() else None


class OtherSurface(MovedPoints):
    """The surface of another subject, its copies included, moved from rest by all its flows."""

    def __init__(self, motion: Motion) -> None:
        super().__init__(motion.flow)
        self.motion = motion

    @cached_property
    def mesh(self) -> Any:
        """The mesh at rest."""
        size = float(np.ptp(self.motion.subject.body.build().vertices, axis=0).max())
        return self.motion.mesh_at_rest(size / FINENESS)

    @cached_property
    def samples(self) -> MovedPoints:
        """Up to SAMPLES of its vertices, which tell whether it keeps its shape.

        They are drawn at random: of a grid, one in so many may all be in a few columns.
        """
        order = np.random.default_rng(1).permutation(len(self.mesh.vertices))
        return MovedPoints(self.flow, self.mesh.vertices[order[:SAMPLES]])

    def rest_points(self) -> Floats:
        return np.ascontiguousarray(self.mesh.vertices)

    def cache_data(self, time: float, dt: float) -> list[Any]:
        """Return what decides the surface at the end of a step, from its start on, JSON-able."""
        start = self.motion.start_data()
        kept = {name: start[name] for name in ("subject", "place", "copies") if name in start}
        first, last = sorted((time, time + dt))
        cells = range(math.floor(first / STEP), math.ceil(last / STEP))
        return [kept, *(self.flow.cache_data(i * STEP, min(STEP, last - i * STEP)) for i in cells)]


@dataclass
class Obstacle:
    """Another subject of the shot, as a subject on one side of it meets it.

    name      in the shot file
    earlier   the motion of the subject that meets it
    subjects  the motions of the shot's subjects, complete once the shot is read
    side      direction from it to the subject; None for that in which their boxes lie farthest apart at the
              start
    """

    name: str
    earlier: EarlierMotion
    subjects: Mapping[str, Motion | None] = field(repr=False)
    side: tuple[float, float, float] | None = None
    known: dict[tuple[float, float], tuple[Floats, Heights]] = field(default_factory=dict, repr=False)

    @cached_property
    def surface(self) -> OtherSurface:
        """Its surface. Raises FrameError for subjects that have none to press against."""
        motion = self.subjects[self.name]
        assert motion is not None, "the shot is read"
        reason = None
        if not motion.subject.is_surface:
            reason = "it has no surface"
        elif motion.is_rigid:
            reason = "it has rigid copies"
        elif motion.animated is not None and not motion.animated.model.keeps_faces:
            reason = "its faces change from frame to frame"
        if reason is not None:
            raise FrameError(f"contact cannot press against {self.name}: {reason}. Take it out of others.")
        return OtherSurface(motion)

    @cached_property
    def axes(self) -> Floats:
        """The rows a, up and b, orthonormal."""
        if self.side is None:
            rest, other = self.earlier.points(0.0), self.surface.points(0.0)
            apart = [(rest @ side).min() - (other @ side).max() for side in SIDES]
            x, y, z = (float(x) for x in SIDES[int(np.argmax(apart))])
            self.side = x, y, z
        up = np.array(self.side) / np.linalg.norm(self.side)
        across = np.eye(3)[int(np.argmin(np.abs(up)))]
        a = np.cross(up, np.cross(across, up))
        a /= np.linalg.norm(a)
        return np.array([a, up, np.cross(a, up)])

    def relief(self, time: float, fall: float) -> tuple[Floats, Heights]:
        """Return the axes and the heights at a time; of one that no flow moves, the same at all times.

        The heights of one that is carried, and turned about the direction that it is met from, are those at
        the start, and its axes turn with it: so its relief keeps its shape, and takes less time.
        """
        at = time if self.surface.flow.members else 0.0
        key = (at, fall)
        if key not in self.known:
            axes, mesh, some = self.axes, self.surface.mesh, self.surface.samples
            rigid = rigid_motion(some.points(0.0), some.points(at)) if at else None
            if rigid and np.abs(rigid[0] @ axes[1] - axes[1]).max() < RIGID:
                axes = axes @ rigid[0].T
                heights = self.relief(0.0, fall)[1].moved(axes @ rigid[1])
            else:
                points = mesh.vertices @ rigid[0].T + rigid[1] if rigid else self.surface.points(at)
                heights = Heights.of(points @ axes.T, mesh.faces, fall)
            self.known[key] = axes, heights
        return self.known[key]
