"""Films of the figures: a surface in a flow, with and without resampling."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.flow import Flow
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.resample import Report, Resampler

if TYPE_CHECKING:
    from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler

RATE = 24
"""Frames per second."""


def resample_film(surface: Resampler | PolyhedralResampler, flow: Flow, frames: int) -> Iterator[Report]:
    """Yield each frame's report: first of the subject at rest, then after each frame of the flow (P6)."""
    yield surface.resample()
    for frame in range(frames):
        surface.vertices[:] = flow.displace(surface.vertices, frame / RATE, 1 / RATE)
        yield surface.resample()


def displace_film(points: Points, flow: Flow, frames: int) -> Iterator[Points]:
    """Yield each frame's vertices (V, 3), moved only."""
    yield points
    for frame in range(frames):
        points = flow.displace(points, frame / RATE, 1 / RATE)
        yield points


def edge_lengths(mesh: TriangleMesh | PolygonMesh) -> Floats:
    """Return edge lengths (E,), scene units, each edge once."""
    polygons = PolygonMesh.from_triangles(mesh) if isinstance(mesh, TriangleMesh) else mesh
    ends = mesh.vertices[polygons.edges]
    lengths: Floats = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return lengths


def volume(mesh: TriangleMesh) -> float:
    """Return the volume of a closed surface, cubic scene units."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def sphericity(mesh: TriangleMesh) -> float:
    """Return the area of the ball of equal volume over the surface's own: 1 for a ball, 0.806 for a cube.

    Source: Wadell, *Volume, Shape, and Roundness of Quartz Particles*, Journal of Geology 43 (1935).
    """
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    return float(math.pi ** (1 / 3) * (6 * volume(mesh)) ** (2 / 3) / area)
