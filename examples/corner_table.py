"""The corner table: two arrays that hold a surface's connectivity, drawn with the surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from examples.drawing import COOL, GREY, INK, WARM, dots, outline, page, save
from flowsculpt.pipeline.arrays import Indices, Points
from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATCH = TriangleMesh(
    [(-1.6, -0.35, 0), (0.05, -1.15, 0), (0.0, 0.75, 0), (1.9, -0.8, 0), (2.1, 1.15, 0)],
    [(0, 1, 2), (1, 3, 2), (2, 3, 4)],
)
INSET = 0.14
"""Distance of a drawn half-edge from its edge, scene units."""


def sides(mesh: TriangleMesh, inset: float = INSET) -> Points:
    """Return the start and end of each drawn half-edge (3 F, 2, 2): the sides of each face, moved inwards."""
    corners = mesh.vertices[mesh.faces][:, :, :2]
    along = np.roll(corners, -1, axis=1) - corners
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    back = np.roll(along, 1, axis=1)
    sine = back[..., 0] * along[..., 1] - back[..., 1] * along[..., 0]
    inner = corners + inset * (along - back) / sine[..., None]
    return np.stack([inner, np.roll(inner, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def draw() -> None:
    table = HalfedgeMesh(PATCH)
    figure, (panel, cells) = page(("", ""), height=3.3, drawings=True)
    outline(panel, PATCH, linewidths=0.9)
    for h, (start, end) in enumerate(sides(PATCH)):
        colour = GREY if table.arrays.twin[h] < 0 else WARM
        panel.annotate(
            "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 3, "shrinkB": 3}
        )
        write(panel, inwards((start + end) / 2, h), str(h), colour)
    dots(panel, PATCH.vertices, INK, 20)
    for v, point in enumerate(PATCH.vertices):
        out = point - PATCH.vertices.mean(axis=0)
        write(panel, point + 0.17 * out / np.linalg.norm(out), f"v{v}", INK)
    for f, middle in enumerate(PATCH.vertices[PATCH.faces].mean(axis=1)):
        write(panel, middle, f"f{f}", COOL)
    rows: dict[str, Indices] = {
        "h": np.arange(9, dtype=np.int32),
        "vert": table.arrays.vert[:9],
        "twin": table.arrays.twin[:9],
    }
    for line, (name, values) in enumerate(rows.items()):
        colour = WARM if name == "h" else INK
        cells.text(-0.4, -line, name, ha="right", va="center", color=colour)
        for h, value in enumerate(values):
            write(cells, np.array([h, -line]), str(value), GREY if value < 0 else colour)
    for f in range(3):
        cells.plot([3 * f - 0.4, 3 * f + 2.4], [0.55, 0.55], color=COOL, linewidth=1.4)
        write(cells, np.array([3 * f + 1, 0.85]), f"f{f}", COOL)
    cells.set(xlim=(-1.6, 8.6), ylim=(-3.4, 1.6))
    save(figure, "corner_table.svg")


def write(panel: Axes, place: Points, text: str, colour: str) -> None:
    """Write a word centred on a place."""
    panel.text(float(place[0]), float(place[1]), text, color=colour, ha="center", va="center")


def inwards(middle: Points, h: int) -> Points:
    """Return a place beside a half-edge, towards the middle of its face."""
    towards = PATCH.vertices[PATCH.faces[h // 3]].mean(axis=0)[:2] - middle
    place: Points = middle + 0.13 * towards / np.linalg.norm(towards)
    return place


if __name__ == "__main__":
    draw()
