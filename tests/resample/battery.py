"""The cases of the battery: kinds of mesh and flows, in units of which one is the size of the subject."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus
from flowsculpt.pipeline.mesh.analytic_surfaces import lattice

Move = Callable[[Points, int], Points]
"""A flow of one frame: points (N, 3) and the frame's number to the moved points."""


def bipyramid(sides: int, height: float = 1.0) -> TriangleMesh:
    """Return two cones of that many faces each; their tips are crowded."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(sides)])
    here = np.arange(sides)
    there = np.roll(here, -1)
    top = np.column_stack([here, there, np.full(sides, sides)])
    bottom = np.column_stack([there, here, np.full(sides, sides + 1)])
    points = np.concatenate([ring, [[0, 0, height], [0, 0, -height]]])
    return TriangleMesh(points, np.concatenate([top, bottom]))


def fan(sides: int) -> TriangleMesh:
    """Return a disk whose faces all share its centre."""
    whole = bipyramid(sides)
    return TriangleMesh(whole.vertices[:-1] * [1, 1, 0], whole.faces[:sides])


def tube(sides: int, rows: int) -> TriangleMesh:
    """Return an open cylinder with two boundaries."""
    angle, height = np.meshgrid(2 * np.pi * np.arange(sides) / sides, np.linspace(-1, 1, rows))
    points = np.column_stack([0.5 * np.cos(angle).ravel(), 0.5 * np.sin(angle).ravel(), height.ravel()])
    column, row = np.meshgrid(np.arange(sides), np.arange(rows - 1))
    a, b = (row * sides + column).ravel(), (row * sides + (column + 1) % sides).ravel()
    return TriangleMesh(
        points,
        np.concatenate([np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])]),
    )


def scaled(mesh: TriangleMesh, factors: tuple[float, float, float]) -> TriangleMesh:
    return mesh.with_vertices(mesh.vertices * factors)


def spiky() -> TriangleMesh:
    """Return a ball whose vertices lie at very different distances from its centre."""
    ball = icosphere(6)
    return ball.with_vertices(
        ball.vertices * np.random.default_rng(1).uniform(0.5, 1.4, (len(ball.vertices), 1))
    )


def crowded_at_a_pole() -> TriangleMesh:
    """Return a ball whose vertices crowd at one pole, so that edges differ by a factor of a hundred."""
    ball = icosphere(7)
    x, y, z = ball.vertices.T
    polar = np.pi * (np.arccos(np.clip(z, -1, 1)) / np.pi) ** 2.5
    around = np.arctan2(y, x)
    return ball.with_vertices(
        np.column_stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    )


def several() -> TriangleMesh:
    """Return a ball, a tetrahedron and a sheet that do not touch."""
    tetrahedron = TriangleMesh(
        0.3 * np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]]),
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )
    parts, offsets = (
        (scaled(icosphere(4), (0.4, 0.4, 0.4)), tetrahedron, sheet((0.5, 0.5), 0.2)),
        (-0.7, 0.0, 0.7),
    )
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return TriangleMesh(
        np.concatenate([part.vertices + np.array([x, 0, 0]) for part, x in zip(parts, offsets, strict=True)]),
        np.concatenate([part.faces + n for part, n in zip(parts, first, strict=True)]),
    )


def creased() -> TriangleMesh:
    """Return a ball with a third of its edges tagged, in no order."""
    ball = icosphere(5)
    edges = ball.faces[:, :2]
    return ball.with_creases(edges[np.random.default_rng(2).random(len(edges)) < 0.33])


MESHES: dict[str, Callable[[], TriangleMesh]] = {
    "ball": lambda: icosphere(6),
    "octahedron": lambda: bipyramid(4),
    "cube": lambda: box(edge_length=0.5),
    "plate": lambda: box(size=(2, 2, 0.02), edge_length=0.4),
    "ring": lambda: torus(0.8, 0.25, 0.25),
    "bar": lambda: rod(2.0, 0.2, 0.15),
    "cloth": lambda: sheet((2, 2), 0.25),
    "triangle": lambda: TriangleMesh(np.eye(3), [[0, 1, 2]]),
    "bars": lambda: lattice((1.6, 1.6, 1.6), 0.8, 0.2),
    "tips": lambda: bipyramid(60, 0.2),
    "fan": lambda: fan(80),
    "tube": lambda: tube(24, 5),
    "needle": lambda: scaled(icosphere(5), (0.05, 0.05, 1.0)),
    "spikes": spiky,
    "crowd": crowded_at_a_pole,
    "several": several,
    "creases": creased,
}


def _turned(points: Points, angle: AnyArray | float, axis: int) -> Points:
    """Return points turned about a coordinate axis, by one angle or one each."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    turned, c, s = points.copy(), np.cos(angle), np.sin(angle)
    turned[:, u], turned[:, v] = c * points[:, u] - s * points[:, v], s * points[:, u] + c * points[:, v]
    return turned


def _there_and_back(frame: int) -> int:
    """Return 1 in the first fifteen of thirty frames and -1 in the others."""
    return 1 if frame % 30 < 15 else -1


def _vortex(points: Points, frame: int) -> Points:
    centre = np.array([0.4, 0.1, 0])
    away = points - centre
    return _turned(away, 0.6 * np.exp(-(away**2).sum(axis=1) / 0.3), 2) + centre


def _twist(points: Points, frame: int) -> Points:
    return _turned(points, 0.25 * _there_and_back(frame) * points[:, 1], 1)


def _waves(points: Points, frame: int) -> Points:
    return points + 0.05 * np.sin(4 * points[:, [1, 2, 0]] + 0.3 * frame)


def _abc(points: Points, frame: int) -> Points:
    x, y, z = 2.5 * points.T
    speed = np.column_stack(
        [np.sin(z) + 0.8 * np.cos(y), 0.9 * np.sin(x) + np.cos(z), 0.8 * np.sin(y) + 0.9 * np.cos(x)]
    )
    return points + 0.03 * speed


def _lorenz(points: Points, frame: int) -> Points:
    x, y, z = (20 * points + [0, 0, 25]).T
    speed = np.column_stack([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])
    return points + 0.004 / 20 * speed


def _shear(points: Points, frame: int) -> Points:
    return points + 0.1 * _there_and_back(frame) * points[:, [2]] * [1, 0, 0]


def _squash(points: Points, frame: int) -> Points:
    return points * np.array([1.05, 1.05, 0.9]) ** _there_and_back(frame)


def _breathe(points: Points, frame: int) -> Points:
    return points * 1.08 ** _there_and_back(frame)


def _fold(points: Points, frame: int) -> Points:
    """Lay the surface over itself, which no continuous flow does."""
    folded = points.copy()
    folded[:, 2] = np.abs(points[:, 2] + 0.02) - 0.3 if frame % 20 == 10 else points[:, 2] * 1.03
    return folded


def _jumps(points: Points, frame: int) -> Points:
    """Apply a different linear mapping every frame, of determinant 1."""
    matrix = np.eye(3) + 0.15 * np.random.default_rng(frame).normal(size=(3, 3))
    return points @ (matrix / np.cbrt(np.linalg.det(matrix)))


def _sink(points: Points, frame: int) -> Points:
    """Draw everything into one point until little is left, then blow it up again."""
    return points * (0.75 if frame % 40 < 20 else 1 / 0.75)


FLOWS: dict[str, Move] = {
    "vortex": _vortex,
    "twist": _twist,
    "waves": _waves,
    "abc": _abc,
    "lorenz": _lorenz,
    "shear": _shear,
    "squash": _squash,
    "breathe": _breathe,
    "fold": _fold,
    "jumps": _jumps,
    "sink": _sink,
}
