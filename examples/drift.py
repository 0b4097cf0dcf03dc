"""The drift towards triangles (P21): sides of the faces of a polyhedron as it is resampled."""

from __future__ import annotations

import numpy as np

from examples.density import vortex_flow
from examples.drawing import COOL, FAINT, OCHRE, WARM, page, save
from examples.film import resample_film
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.mesh import PolygonMesh
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.resample import Thresholds

FRAMES, LONGEST = 120, 0.25
CUBE = PolygonMesh(
    [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)],
)


def shares(frames: int = FRAMES) -> Floats:
    """Return the shares (frames + 1, 4) of the faces with 3, 4, 5 and more sides."""
    resampler = PolyhedralResampler(CUBE, Thresholds(LONGEST))
    rows = []
    for _ in resample_film(resampler, vortex_flow(4.0), frames):
        counted = np.bincount(np.minimum(resampler.mesh.sides, 6), minlength=7)[3:]
        rows.append(counted / counted.sum())
    return np.array(rows)


def draw() -> None:
    rows = shares()
    figure, (panel,) = page(("faces by their sides",), height=2.9)
    names, colours = ("triangles", "quadrilaterals", "5 sides", "6 and more"), (COOL, OCHRE, WARM, FAINT)
    panel.stackplot(np.arange(len(rows)), 100 * rows.T, colors=colours, labels=names, linewidth=0)
    panel.set(xlabel="frame", ylabel="% of the faces", xlim=(0, len(rows) - 1), ylim=(0, 100))
    handles, labels = panel.get_legend_handles_labels()
    panel.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5))
    panel.grid(visible=False)
    save(figure, "drift.svg")


if __name__ == "__main__":
    draw()
