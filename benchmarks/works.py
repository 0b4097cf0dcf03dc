"""The measured works: single frames of growing size, two films, and the Enright deformation.

A frame is a geodesic sphere after one motion that takes 5% of its edges out of the length limits, above or
below. A film is a flow over many frames that is known backwards too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks import streams
from benchmarks.measures import edges_of, lengths_of
from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere

SHARE_OUT = 0.05
RATIO = 0.4
FREQUENCIES = {"40k": 63, "160k": 126, "640k": 253}
KINDS = ("too long", "too short")


def frame(size: str, kind: str) -> tuple[TriangleMesh, float]:
    """Return a mesh with 5% of its edges outside the length limits, and the maximum edge length.

    Too long: edges in the geometric middle of the limits, turned by a vortex pair. Too short: finer edges,
    drawn together around twelve points.
    """
    ball = icosphere(FREQUENCIES[size])
    edges = edges_of(ball.faces)
    mean = float(lengths_of(ball.vertices, edges).mean())
    longest = mean / math.sqrt(RATIO) if kind == "too long" else mean / 0.55
    move, low, high = (_vortex_pair, 0.0, 2 * math.pi) if kind == "too long" else (_contraction, 0.0, 0.9)
    while high - low > 1e-5:
        strength = (low + high) / 2
        lengths = lengths_of(move(ball.vertices, strength), edges)
        out = np.mean((lengths > longest) | (lengths < RATIO * longest))
        low, high = (strength, high) if out < SHARE_OUT else (low, strength)
    return ball.with_vertices(move(ball.vertices, high)), longest


def _vortex_pair(points: Points, angle: float) -> Points:
    """Apply two opposite swirls about axes along z, one after the other; each keeps volume exactly."""
    moved = points.copy()
    for centre, sign in ((0.75, 1.0), (-0.75, -1.0)):
        x, y = moved[:, 0] - centre, moved[:, 1].copy()
        turn = sign * angle * np.exp(-(x * x + y * y) / 0.2)
        moved[:, 0] = centre + x * np.cos(turn) - y * np.sin(turn)
        moved[:, 1] = x * np.sin(turn) + y * np.cos(turn)
    return moved


def _contraction(points: Points, share: float) -> Points:
    """Move points towards the corners of an icosahedron, by at most `share` of the distance."""
    moved = points.copy()
    for sink in icosphere(1).vertices:
        away = moved - sink
        moved -= share * away * np.exp(-np.einsum("ij,ij->i", away, away) / 0.06)[:, None]
    return moved


@dataclass(frozen=True)
class Film:
    """A subject in a flow that can be followed both ways.

    follow           (points (N, 3), from frame, to frame) -> their positions at the second frame
    swells           the growth of the logarithm of the volume over all frames
    height           (N, 3) -> (N,) signed distance from the true surface at rest
    project          (N, 3) -> (N, 3) nearest points of the true surface, if placement gets it
    """

    name: str
    subject: TriangleMesh
    follow: streams.Follow
    frames: int
    max_edge_length: float
    swells: float
    height: Callable[[Points], Floats]
    project: Callable[[Points], Points] | None


def cube() -> Film:
    """A cube of 10,088 vertices in two vortices and a twist; free of divergence.

    Placement gets no true surface: it must find flat sides and straight creases.
    """
    follow = streams.following(streams.stir, 1 / 120)
    return Film("cube", box(edge_length=2 / 41), follow, 120, 2 / 41 * 1.4143, 0.0, _above_cube, None)


def lorenz() -> Film:
    """A ball of 10,242 vertices in the Lorenz attractor, which draws it to a sheet."""
    ball, at = _Ball(6.0, (3.0, 5.0, 22.0)), streams.following(streams.lorenz, 0.5 / 120)
    subject = icosphere(32, ball.radius, ball.centre)
    longest = float(lengths_of(subject.vertices, edges_of(subject.faces)).mean()) / math.sqrt(RATIO)
    return Film("lorenz", subject, at, 120, longest, -0.5 * (10 + 1 + 8 / 3), ball.height, ball.project)


def enright() -> Film:
    """A ball of 2562 vertices stretched to a thin curled sheet until half time, and back.

    Source: `flowsculpt.pipeline.flow.catalogue.basic`.
    """
    ball, at = _Ball(0.15, (0.35, 0.35, 0.35)), streams.following(streams.enright, 3 / 150)
    subject = icosphere(16, ball.radius, ball.centre)
    return Film("enright", subject, at, 150, 0.02, 0.0, ball.height, ball.project)


def abc() -> Film:
    """A ball of 5762 vertices in three crossed waves that fold it; free of divergence."""
    ball, follow = _Ball(1.0, (0.0, 0.0, 0.0)), streams.following(streams.abc, 2.5 / 120)
    subject = icosphere(24)
    longest = float(lengths_of(subject.vertices, edges_of(subject.faces)).mean()) / math.sqrt(RATIO)
    return Film("abc", subject, follow, 120, longest, 0.0, ball.height, ball.project)


def turned(film: Film, seed: int) -> Film:
    """Return the film with its subject turned about its centre: by nothing for seed 0, else at random."""
    if seed == 0:
        return film
    turn, upper = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turn = turn * np.sign(np.diag(upper))
    turn[:, 0] *= np.linalg.det(turn)
    points = film.subject.vertices
    centre = points.mean(axis=0)
    return replace(film, subject=film.subject.with_vertices((points - centre) @ turn.T + centre))


@dataclass(frozen=True)
class _Ball:
    radius: float
    centre: tuple[float, float, float]

    def height(self, points: Points) -> Floats:
        above: Floats = np.linalg.norm(points - self.centre, axis=1) - self.radius
        return above

    def project(self, points: Points) -> Points:
        away = points - self.centre
        on: Points = self.centre + away * (self.radius / np.linalg.norm(away, axis=1, keepdims=True))
        return on


def _above_cube(points: Points) -> Floats:
    beyond = np.abs(points) - 1.0
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    height: Floats = outside + np.minimum(beyond.max(axis=1), 0.0)
    return height
