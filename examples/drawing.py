"""Panels, pens and colours of the figures: one palette, one typeface, one folder of pictures.

matplotlib is imported where something is drawn, so that the numbers behind a figure need none.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.plugins.review import plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"

PAPER, INK, GREY, FAINT = "#ffffff", plot.INK, plot.GREY, plot.FAINT
WARM, COOL, OCHRE, LEAF = "#c4553b", "#2c6e91", "#d39a2d", "#5b8a5a"
"""Warm is what grows or goes wrong, cool what shrinks or goes right; the others come third and fourth."""

_STYLE: Any = {
    **plot.STYLE,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "font.size": 9,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 8,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
}


def page(
    titles: Sequence[str], height: float = 3.4, drawings: bool = False, bare: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a page 9.6 inches wide with a panel for each title, side by side.

    drawings  equal, invisible axes
    bare      without margins
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    mpl.rcParams.update(_STYLE)
    margin = 0.0 if bare else 0.12
    layout = ConstrainedLayoutEngine(w_pad=margin, h_pad=margin)
    figure = Figure(figsize=(9.6, height), layout=layout)
    FigureCanvasAgg(figure)
    panels = list(np.ravel(figure.subplots(1, len(titles))))
    for panel, title in zip(panels, titles, strict=True):
        panel.set_title(title)
        if drawings:
            panel.set_aspect("equal", anchor="NW")
            panel.set_axis_off()
    return figure, panels


def draw_edge_lines(panel: Axes, mesh: TriangleMesh | PolygonMesh, width: float = 0.7) -> None:
    """Draw the edges of a flat mesh, seen along z, as one path."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    polygons = _polygons(mesh)
    ends = polygons.vertices[polygons.edges][:, :, :2].reshape(-1, 2)
    codes = np.tile([Outline.MOVETO, Outline.LINETO], len(ends) // 2)
    panel.add_patch(
        PathPatch(Outline(ends, codes), fill=False, edgecolor=INK, linewidth=width, capstyle="round")
    )
    panel.autoscale_view()


def outline(panel: Axes, mesh: TriangleMesh | PolygonMesh, view: AnyArray | None = None, **pen: Any) -> None:
    """Draw the faces of a mesh, white with ink edges, seen along z or by a (3, 2) `view`.

    Faces are drawn in the order of their distance, far ones first.
    """
    from matplotlib.collections import PolyCollection

    polygons, view = _polygons(mesh), np.eye(3)[:, :2] if view is None else view
    faces = [polygons.face(f) for f in range(len(polygons))]
    towards = np.cross(view[:, 0], view[:, 1])
    order = np.argsort([(polygons.vertices[face] @ towards).mean() for face in faces], kind="stable")
    style = {"facecolors": "white", "edgecolors": INK, "linewidths": 0.7, "joinstyle": "round", **pen}
    panel.add_collection(PolyCollection([polygons.vertices[faces[f]] @ view for f in order], **style))
    panel.autoscale_view()


def _polygons(mesh: TriangleMesh | PolygonMesh) -> PolygonMesh:
    return PolygonMesh.from_triangles(mesh) if isinstance(mesh, TriangleMesh) else mesh


def dots(panel: Axes, points: AnyArray, colour: str = WARM, size: float = 26, **pen: Any) -> None:
    """Mark vertices, (N, 2) or more columns."""
    points = np.atleast_2d(points)
    panel.scatter(points[:, 0], points[:, 1], s=size, color=colour, zorder=5, linewidths=0, **pen)


def arrows(panels: Sequence[Axes]) -> None:
    """Draw an arrow from each panel to the next."""
    from matplotlib.patches import ConnectionPatch

    for one, other in pairwise(panels):
        arrow = ConnectionPatch(
            (1.0, 0.5),
            (0.0, 0.5),
            "axes fraction",
            "axes fraction",
            axesA=one,
            axesB=other,
            arrowstyle="-|>",
            color=GREY,
            mutation_scale=11,
            linewidth=1.0,
        )
        one.figure.add_artist(arrow)


def save(figure: Figure, name: str) -> Path:
    """Write the figure to `docs/pictures`, the same bytes every time; pixels are opaque."""
    from PIL import Image

    path = PICTURES / name
    figure.savefig(path, dpi=100, metadata={"Date": None} if path.suffix == ".svg" else {})
    if path.suffix == ".png":
        with Image.open(path) as drawn:
            drawn.convert("RGB").save(path, optimize=True)
    print(path.relative_to(PICTURES.parent.parent))
    return path
