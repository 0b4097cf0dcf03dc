"""One mesh of subjects whose motion is a formula, for tests of exports."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh

RATE = FrameRate(24)


def moving(
    surface: TriangleMesh, frames: range = range(1, 25), edge: float = 0.3, there_and_back: bool = False
) -> OneMesh:
    """A surface that is twisted around y, up to 90° for a height of 1, and drifts to the right."""

    def share(number: int) -> float:
        passed = (number - frames.start) / max(len(frames) - 1, 1)
        return 0.5 - 0.5 * math.cos(2.0 * math.pi * passed) if there_and_back else passed

    def points_at(number: int) -> Points:
        x, y, z = surface.vertices.T
        turn = 0.5 * math.pi * share(number) * y
        cosine, sine = np.cos(turn), np.sin(turn)
        return np.stack([cosine * x + sine * z + 3.0 * share(number), y, cosine * z - sine * x], axis=1)

    def velocities_at(number: int) -> Floats:
        return (points_at(number + 1) - points_at(number - 1)) * (RATE.fps / 2)

    mesh = OneMesh.of("twisted", tuple(frames), RATE, surface, "0" * 8, points_at, velocities_at)
    return replace(mesh, longest_at=lambda number: edge)


def painted(mesh: OneMesh) -> OneMesh:
    """The same mesh with colours and with texture coordinates, which have a seam."""
    low, high = mesh.rest.min(axis=0), mesh.rest.max(axis=0)
    x, y, z = mesh.rest[mesh.faces].transpose(2, 0, 1)
    around = np.arctan2(z, x) / (2.0 * math.pi)
    around = np.where(around.max(axis=1, keepdims=True) - around > 0.5, around + 1.0, around)
    return replace(
        mesh, colours=(mesh.rest - low) / (high - low), texture=np.stack([around, 0.5 + 0.5 * y], axis=2)
    )


def ball(**more: object) -> DrawnMesh:
    return DrawnMesh.of(moving(icosphere(8), **more))  # type: ignore[arg-type]


def painted_box() -> DrawnMesh:
    return DrawnMesh.of(painted(moving(box(2))))
