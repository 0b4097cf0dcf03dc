"""Polyhedra of all kinds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import PolygonMesh, icosphere, sheet

SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
ELL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
COMB = [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (4, 1), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)]
STAR = [
    ((1 if k % 2 else 2) * math.cos(math.pi * k / 5), (1 if k % 2 else 2) * math.sin(math.pi * k / 5))
    for k in range(10)
]
ROUND = [(math.cos(2 * math.pi * k / 40), math.sin(2 * math.pi * k / 40)) for k in range(40)]


def prism(outline: Sequence[tuple[float, float]], height: float = 1.0) -> PolygonMesh:
    """An outline, counter-clockwise, drawn along y: two faces of n sides and n quads."""
    n = len(outline)
    points = [(x, y, -z) for y in (0.0, height) for x, z in outline]
    walls = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return PolygonMesh(points, [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *walls])


def ring(around: int = 5, tube: int = 4) -> PolygonMesh:
    """A torus of quads."""
    points = []
    for i in range(around):
        for j in range(tube):
            a, b = 2 * math.pi * i / around, 2 * math.pi * j / tube
            points.append(((2 + math.cos(b)) * math.cos(a), math.sin(b), (2 + math.cos(b)) * math.sin(a)))
    number = np.arange(around * tube).reshape(around, tube)
    on = np.roll(number, -1, axis=0)
    quads = np.stack([number, np.roll(number, -1, axis=1), np.roll(on, -1, axis=1), on], axis=2)
    return PolygonMesh(points, list(quads.reshape(-1, 4)))


def open_box() -> PolygonMesh:
    """A cube of quads without its lid."""
    whole = prism(SQUARE, 2.0)
    return PolygonMesh(whole.vertices, [whole.face(f) for f in (0, 2, 3, 4, 5)])


TETRAHEDRON = PolygonMesh(
    [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
)

MENAGERIE = {
    "cube": prism(SQUARE, 2.0),
    "ell": prism(ELL),
    "comb": prism(COMB, 2.0),
    "star": prism(STAR),
    "drum": prism(ROUND, 0.7),
    "ring": ring(),
    "open box": open_box(),
    "leaf": PolygonMesh([(x, 0, -z) for x, z in STAR], [range(10)]),
    "tetrahedron": TETRAHEDRON,
    "ball": PolygonMesh.from_triangles(icosphere(3)),
    "cloth": PolygonMesh.from_triangles(sheet((2, 2), 0.5)),
}


@pytest.fixture(scope="session")
def menagerie() -> dict[str, PolygonMesh]:
    """Closed and open, concave, with holes through them, of triangles, quads and faces of forty sides."""
    return MENAGERIE
