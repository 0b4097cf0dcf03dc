"""The works that are measured: single frames of growing size, and two films.

A frame is a geodesic sphere, meshed in the geometric middle of the bracket and turned by a vortex pair
until 5% of its edges are out. A film is 120 frames of a flow.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats, Indices, Points
from pipeline.mesh import TriangleMesh, box, icosphere

SHARE_OUT = 0.05
RATIO = 0.4
FREQUENCIES = {"40k": 63, "160k": 126, "640k": 253}
FRAMES = 120


@dataclass(frozen=True)
class Film:
    """A subject, the velocity that moves it, how long (seconds), and the maximum edge length."""

    subject: TriangleMesh
    velocity: Callable[[Points], Points]
    duration: float
    max_edge_length: float
    divergence: float


def edges_of(mesh: TriangleMesh) -> Indices:
    """(E, 2), each edge once."""
    pairs = np.sort(np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    return np.unique(pairs, axis=0).astype(np.int32)


def lengths_of(points: Points, edges: Indices) -> Floats:
    lengths: Floats = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return lengths


def frame(size: str) -> tuple[TriangleMesh, float]:
    """The mesh of that size with 5% of its edges out of the bracket, and the maximum edge length."""
    ball = icosphere(FREQUENCIES[size])
    edges = edges_of(ball)
    longest = float(lengths_of(ball.vertices, edges).mean()) / math.sqrt(RATIO)
    low, high = 0.0, 2 * math.pi
    while high - low > 1e-4:
        angle = (low + high) / 2
        lengths = lengths_of(_vortex_pair(ball.vertices, angle), edges)
        out = np.mean((lengths > longest) | (lengths < RATIO * longest))
        low, high = (angle, high) if out < SHARE_OUT else (low, angle)
    return ball.with_vertices(_vortex_pair(ball.vertices, high)), longest


def films() -> dict[str, Film]:
    """A cube in two vortices and a twist, and a ball in the Lorenz attractor."""
    ball = icosphere(32, 6.0, (3.0, 5.0, 22.0))
    middle = float(lengths_of(ball.vertices, edges_of(ball)).mean())
    return {
        "cube": Film(box(edge_length=2 / 41), _stir, 1.0, 2 / 41 * math.sqrt(2.0001), 0.0),
        "lorenz": Film(ball, _lorenz, 0.5, middle / math.sqrt(RATIO), -(10 + 1 + 8 / 3)),
    }


def advance(film: Film, points: Points) -> Points:
    """One frame of the film's flow by the classical Runge-Kutta method."""
    dt, u = film.duration / FRAMES, film.velocity
    a = u(points)
    b = u(points + dt / 2 * a)
    c = u(points + dt / 2 * b)
    d = u(points + dt * c)
    return points + dt / 6 * (a + 2 * b + 2 * c + d)


def _vortex_pair(points: Points, angle: float) -> Points:
    """Two opposite swirls about axes along z, one after the other; each keeps volume exactly."""
    moved = points.copy()
    for centre, sign in ((0.75, 1.0), (-0.75, -1.0)):
        x, y = moved[:, 0] - centre, moved[:, 1].copy()
        turn = sign * angle * np.exp(-(x * x + y * y) / 0.2)
        moved[:, 0] = centre + x * np.cos(turn) - y * np.sin(turn)
        moved[:, 1] = x * np.sin(turn) + y * np.cos(turn)
    return moved


def _stir(points: Points) -> Points:
    """Two counter-rotating Gaussian vortices about z and a twist about y; free of divergence."""
    x, y, z = points.T
    velocity = np.column_stack([1.2 * y * z, np.zeros_like(x), -1.2 * y * x])
    for centre, strength in ((0.9, 4.0), (-0.9, -4.0)):
        swirl = strength * np.exp(-((x - centre) ** 2 + y * y) / 0.64)
        velocity[:, 0] -= swirl * y
        velocity[:, 1] += swirl * (x - centre)
    return velocity


def _lorenz(points: Points) -> Points:
    x, y, z = points.T
    return np.column_stack([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])
