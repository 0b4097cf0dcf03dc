"""Figure E: collapsing an edge leaves one vertex, at the midpoint or on the crease (P27, P30)."""

from __future__ import annotations

import math

import numpy as np

from examples.drawing import COOL, WARM, arrows, dots, outline, page, save
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.resample import Thresholds, resample

THRESHOLDS = Thresholds(max_edge_length=2.0, min_edge_length=0.5)
SHORT = (3, 4)
"""The vertices of the short edge, in both patches."""

_POINTS = [
    (-1.1, -0.55),
    (-0.9, 0.6),
    (-0.1, -1.0),
    (-0.2, 0.05),
    (0.2, -0.05),
    (0.1, 1.0),
    (1.1, 0.5),
    (0.9, -0.6),
]
_FACES = [(0, 3, 1), (0, 2, 3), (2, 4, 3), (2, 7, 4), (7, 6, 4), (6, 5, 4), (5, 3, 4), (5, 1, 3)]  # fmt: skip

VIEW = np.array([[1.0, 0.0], [0.28, 0.55], [0.0, 0.75]])
"""The folded patch from above, along its crease."""


def flat() -> TriangleMesh:
    """Return eight triangles around one short edge, in the plane z = 0."""
    return TriangleMesh([(x, y, 0) for x, y in _POINTS], _FACES)


def folded(angle: float = math.radians(90)) -> TriangleMesh:
    """Return the patch bent by an angle, radians, over a crease along y through one end of the short edge."""
    points = np.array([(x, y, 0) for x, y in _POINTS], np.float64)
    points[[2, 3, 5], 0] = 0.0  # the crease
    aside = points[:, 0].copy()
    points[:, 0], points[:, 2] = aside * math.cos(angle / 2), -np.abs(aside) * math.sin(angle / 2)
    return TriangleMesh(points, _FACES)


def collapse(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh without the short edge; the first of its two vertices is left."""
    return resample(mesh, THRESHOLDS, min_roundness=0.0)[0]


def merged_vertex(before: TriangleMesh, after: TriangleMesh) -> AnyArray:
    """Return the vertex (3,) that has replaced two: the one nearest to their midpoint."""
    middle = before.vertices[list(SHORT)].mean(axis=0)
    nearest: AnyArray = after.vertices[np.linalg.norm(after.vertices - middle, axis=1).argmin()]
    return nearest


def draw() -> None:
    titles = (
        "an edge is too short",
        "one vertex, at its middle",
        "one end lies on a crease",
        "and keeps its place",
    )
    figure, panels = page(titles, height=2.4, drawings=True)
    for mesh, (left, right), view in ((flat(), panels[:2], np.eye(3)[:, :2]), (folded(), panels[2:], VIEW)):
        after = collapse(mesh)
        for panel, shown in ((left, mesh), (right, after)):
            outline(panel, shown, view, linewidths=0.9)
            if view is VIEW:
                panel.plot(*(mesh.vertices[[2, 3, 5]] @ view).T, color=COOL, linewidth=2.2)
        left.plot(*(mesh.vertices[list(SHORT)] @ view).T, color=WARM, linewidth=2.6)
        dots(left, mesh.vertices[list(SHORT)] @ view)
        dots(right, merged_vertex(mesh, after) @ view)
        arrows([left, right])
    save(figure, "figure_e.svg")


if __name__ == "__main__":
    draw()
