"""Figure D: splitting a long edge and its two triangles, until none is long (P24, P25)."""

from __future__ import annotations

import numpy as np

from examples.drawing import WARM, arrows, dots, outline, page, save
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.resample import Report, Thresholds, resample

PAIR = TriangleMesh([(-1, 0.1, 0), (0.05, -0.72, 0), (1, -0.1, 0), (-0.1, 0.75, 0)], [(0, 1, 2), (0, 2, 3)])
"""Two triangles; the edge between them is the longest."""

STRETCHED = TriangleMesh([(-1, -0.8, 0), (1.05, -0.7, 0), (-0.35, 0.85, 0)], [(0, 1, 2)])
"""One triangle, many times too large."""


def split(mesh: TriangleMesh, longest: float) -> tuple[TriangleMesh, Report]:
    """Split edges only: no edge is too short, and no triangle is improved."""
    return resample(mesh, Thresholds(longest, 0.0), min_roundness=0.0)


def draw() -> None:
    once, _ = split(PAIR, 1.5)
    filled, report = split(STRETCHED, 0.3)
    titles = (
        "an edge is too long",
        "split, with both its triangles",
        "many times too long",
        f"until none is: {report.passes} passes",
    )
    figure, panels = page(titles, height=2.4, drawings=True)
    for panel, mesh in zip(panels, (PAIR, once, STRETCHED, filled), strict=True):
        outline(panel, mesh, linewidths=0.9)
    for panel, ends in ((panels[0], PAIR.vertices[[0, 2]]), (panels[2], STRETCHED.vertices)):
        ends = ends if len(ends) == 2 else ends[[0, 1, 2, 0]]
        panel.plot(*ends[:, :2].T, color=WARM, linewidth=2.2)
    dots(panels[1], once.vertices[len(PAIR.vertices) :])
    dots(panels[3], filled.vertices[len(STRETCHED.vertices) :], size=7)
    arrows(panels[:2])
    arrows(panels[2:])
    save(figure, "figure_d.svg")


def longest_edge(mesh: TriangleMesh) -> float:
    """Return the length of the longest edge, scene units."""
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max())


if __name__ == "__main__":
    draw()
