"""Figure C: slicing a face with a series of planes, like bread (P17-P19)."""

from __future__ import annotations

import math

import numpy as np

from examples.drawing import COOL, FAINT, OCHRE, WARM, outline, page, save
from flowsculpt.pipeline.mesh import PolygonMesh
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import Cutting
from flowsculpt.pipeline.resample import Thresholds

LONGEST = 1.0
SHADES = (FAINT, "white", OCHRE + "44")


def loaf(corners: int = 200) -> PolygonMesh:
    """Return one large face of many short edges, 5.6 long."""
    turn = 2 * math.pi * (np.arange(corners) + 0.5) / corners
    x, y = (np.sign(part) * np.abs(part) ** 0.5 for part in (np.cos(turn), np.sin(turn)))
    crust = np.where(y > 0, 0.52 - 0.06 * np.cos(3 * x), 0.4)
    return PolygonMesh(np.column_stack([2.8 * x, crust * y, np.zeros(corners)]), [range(corners)])


def horseshoe(corners: int = 26) -> PolygonMesh:
    """Return a concave face: planes cross its outline four times."""
    turn = np.linspace(-0.25 * math.pi, 1.25 * math.pi, corners)
    arc = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(corners)])
    return PolygonMesh(np.concatenate([1.9 * arc, arc[::-1]]), [range(2 * corners)])


def slice_face(face: PolygonMesh, cutting: Cutting = "slice") -> PolygonMesh:
    """Return the face after one resampling that removes nothing."""
    resampler = PolyhedralResampler(face, Thresholds(LONGEST, 0.0), cutting)
    resampler.resample()
    return resampler.mesh


def draw() -> None:
    face, bread, halves = loaf(), slice_face(loaf()), slice_face(loaf(), "recurse")
    figure, (left, right) = page(
        ("", "a concave face, whose outline a plane may cross four times"), 3.3, drawings=True
    )
    stack = (
        (0.0, face, "a face too long, of short edges; planes cut its longest dimension"),
        (-1.75, bread, f"all cuts at once, like bread: {len(bread)} parts"),
        (-3.3, halves, f"cut in two, and again: {len(halves)} parts"),
    )
    for height, mesh, title in stack:
        lifted = mesh.with_vertices(mesh.vertices + np.array([0, height, 0]))
        outline(left, lifted, facecolors=[SHADES[f % 2] for f in range(len(mesh))])
        left.text(-2.8, height + 0.72, title, fontsize=9.5)
    (low_x, low, _), (high_x, high, _) = face.bounds
    left.plot([low_x, high_x, high_x, low_x, low_x], [low, low, high, high, low], color=COOL, linewidth=0.9)
    for level in np.linspace(low_x, high_x, len(bread) + 1)[1:-1]:
        left.plot([level, level], [low - 0.16, high + 0.16], color=WARM, linewidth=1.2, dashes=(4, 2))
    shoe = slice_face(horseshoe())
    outline(right, shoe, facecolors=[SHADES[f % 3] for f in range(len(shoe))])
    save(figure, "figure_c.svg")


if __name__ == "__main__":
    draw()
