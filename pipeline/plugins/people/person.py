"""The subject `people.person`: a plain standing or walking person, smooth and closed, for scale.

Limbs are cones with round ends, one after another. Where limbs meet, they are blended: the distance to the
surface is -k log Σ exp(-dᵢ / k) of the distances to the limbs. Its zero is meshed on a grid by surface
nets (Gibson 1998), and the vertices are moved onto it by Newton steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from flowsculpt import TriangleMesh
from flowsculpt.api import SubjectKind
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.api.shots import Positive

BLEND = 0.016
"""Width of the blends between limbs, over the height of the person."""

CELL = 1 / 84
"""Side of the grid's cells, over the height."""

STRIDE, SWING, BEND = math.radians(24.0), math.radians(20.0), math.radians(14.0)
"""Angles of a walking person: of the legs and of the arms from the vertical, and of knees and elbows."""

Joint = tuple[float, float, float]
Field3D = Callable[[Floats], Floats]


Pose = Literal["standing", "walking"]


class PersonKind(SubjectKind):
    """A standing or walking person for scale, facing along z, with the feet at y = 0."""

    height: Positive = Field(
        1.75, description="from the soles to the crown: 1.75 m where unit is 1000 (units)"
    )
    pose: Pose = Field("standing", description="still, or in mid-stride")

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        return {"pose": value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"enum": list(get_args(Pose))}]}

    def surface(self, folder: Path) -> TriangleMesh:
        """Return the surface of the person."""
        mesh = person(self.pose)
        return TriangleMesh(self.height * mesh.vertices, mesh.faces)


@lru_cache(maxsize=2)
def person(pose: str) -> TriangleMesh:
    """Return the surface of a person one unit tall, facing along z, with the feet at y = 0."""
    limbs = _limbs(pose)
    joints = np.concatenate([limb[:, :6] for limb in limbs]).reshape(-1, 3)
    low, high = joints.min(axis=0) - 0.1, joints.max(axis=0) + 0.1
    points, faces = surface_net(lambda at: distance(at, limbs), low, high, CELL)
    points -= [0.0, points[:, 1].min(), 0.0]
    return TriangleMesh(points / points[:, 1].max(), faces)


def distance(points: Floats, limbs: Sequence[Floats]) -> Floats:
    """Return the distance (N,) of points (N, 3) to the blended surface, below 0 inside.

    limbs  (C, 8) each: cones one after another, by their ends and the radii there
    """
    total = np.zeros(len(points))
    for limb in limbs:
        nearest = np.full(len(points), np.inf)
        for cone in limb:
            start, along = cone[:3], cone[3:6] - cone[:3]
            share = np.clip((points - start) @ along / float(along @ along), 0.0, 1.0)
            apart = np.linalg.norm(points - start - share[:, None] * along, axis=1)
            np.minimum(nearest, apart - cone[6] - share * (cone[7] - cone[6]), out=nearest)
        total += np.exp(np.minimum(-nearest / BLEND, 600.0))
    return np.asarray(-BLEND * np.log(np.maximum(total, 1e-300)))


def _limbs(pose: str) -> list[Floats]:
    """Return the limbs of a body about one unit tall, as `distance` takes them."""
    limbs = [_limb(((0.0, 0.83, -0.004), 0.032), ((0.0, 0.90, 0.004), 0.030))]
    limbs.append(_limb(((0.0, 0.915, 0.010), 0.043), ((0.0, 0.950, 0.004), 0.049)))
    walks = pose == "walking"
    for side in (-1.0, 1.0):
        chest, waist = (side * 0.052, 0.765, 0.0), (side * 0.036, 0.645, 0.0)
        hip, shoulder = (side * 0.050, 0.525, -0.004), (side * 0.112, 0.795, -0.004)
        leg, arm = (side * STRIDE, -side * SWING) if walks else (0.0, math.radians(1.0))
        is_behind = walks and leg < 0.0
        knee = _onward(hip, leg, 0.24, side * 0.010)
        ankle = _onward(
            knee, leg - (1.5 * is_behind + 0.3 * (walks and not is_behind)) * BEND, 0.235, side * 0.004
        )
        sole = leg - 1.2 * BEND * is_behind
        heel, toe = _onward(ankle, sole - 0.5, 0.022, 0.0), _onward(ankle, sole + 1.27, 0.094, side * 0.008)
        elbow, bent = _onward(shoulder, arm, 0.165, side * 0.042), arm + (1.0 if walks else 0.5) * BEND
        wrist, hand = _onward(elbow, bent, 0.145, side * 0.006), _onward(elbow, bent, 0.205, side * 0.006)
        limbs += [
            _limb((chest, 0.046), (waist, 0.042), (hip, 0.047)),
            _limb((hip, 0.047), (knee, 0.037), (ankle, 0.025)),
            _limb((heel, 0.022), (toe, 0.020)),
            _limb((chest, 0.032), (shoulder, 0.030)),
            _limb((shoulder, 0.030), (elbow, 0.026), (wrist, 0.020), (hand, 0.022)),
        ]
    return limbs


def _limb(*ends: tuple[Joint, float]) -> Floats:
    """Return cones (C, 8) between joints with radii."""
    return np.array([[*a, *b, r, s] for (a, r), (b, s) in pairwise(ends)])


def _onward(start: Joint, angle: float, length: float, aside: float) -> Joint:
    """Return the end of a limb that hangs down, swung forwards by an angle."""
    x, y, z = start
    return x + aside, y - length * math.cos(angle), z + length * math.sin(angle)


def surface_net(field: Field3D, low: Floats, high: Floats, cell: float) -> tuple[Floats, Indices]:
    """Return vertices (V, 3) and triangles (F, 3), seen from outside, of the zero of a field.

    field      returns values (N,) at points (N, 3), below 0 inside
    low, high  (3,), corners of a box around it
    """
    axes = [np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = (field(grid.reshape(-1, 3)) < 0.0).reshape(grid.shape[:3])
    _fill_crossings(inside)
    corners = [
        inside[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None]
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    ]
    count = np.sum(corners, axis=0)
    mixed = (count > 0) & (count < 8)
    number = np.full(mixed.shape, -1)
    number[mixed] = np.arange(mixed.sum())
    points = grid[:-1, :-1, :-1][mixed] + 0.5 * cell
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        before, after = (
            np.moveaxis(inside, (axis, u, v), (0, 1, 2))[part] for part in (slice(None, -1), slice(1, None))
        )
        cells = np.moveaxis(number, (axis, u, v), (0, 1, 2))
        for leaves in (True, False):
            edge = np.argwhere((before != after) & (before == leaves))
            i, j, k = edge.T
            ring = [cells[i, j - 1, k - 1], cells[i, j, k - 1], cells[i, j, k], cells[i, j - 1, k]]
            quads.append(np.stack(ring if leaves else ring[::-1], axis=1))
    found = np.concatenate(quads)
    faces = np.concatenate([found[:, [0, 1, 2]], found[:, [0, 2, 3]]]).astype(np.int32)
    for _ in range(4):  # evens the triangles out
        points = _nearer(field, _nearer(field, _relax(points, found)))
    return points, faces


def _relax(points: Floats, quads: np.ndarray) -> Floats:
    """Return the means (V, 3) of the middles of the quadrilaterals (Q, 4) around each point."""
    middles = points[quads].mean(axis=1)
    sums = [np.bincount(quads.ravel(), np.repeat(middles[:, k], 4)) for k in range(3)]
    return np.stack(sums, axis=1) / np.bincount(quads.ravel())[:, None]


def _fill_crossings(inside: np.ndarray) -> None:
    """Fill faces of cells of which two opposite corners alone are inside: the surface would cross itself."""
    while True:
        count = inside.sum()
        for axis in range(3):
            side = np.moveaxis(inside, axis, 0)
            a, b, c, d = side[:, :-1, :-1], side[:, 1:, :-1], side[:, :-1, 1:], side[:, 1:, 1:]
            crossed = (a == d) & (b == c) & (a != b)
            for corner in (a, b, c, d):
                corner |= crossed
        if inside.sum() == count:
            return


def _nearer(field: Field3D, points: Floats) -> Floats:
    """Return points moved by a Newton step towards the zero of a field."""
    step = 1e-4
    values = field(points)
    slope = np.stack([field(points + step * axis) - values for axis in np.eye(3)], axis=1) / step
    return np.asarray(points - (values / np.maximum((slope**2).sum(axis=1), 1e-6))[:, None] * slope)
