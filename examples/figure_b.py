"""Figure B: a sheet in a disc of expansion, upper right, and an overlapping disc of contraction (P15)."""

from __future__ import annotations

from collections import deque

import numpy as np

from examples.drawing import COOL, WARM, draw_edge_lines, page, save
from examples.film import displace_film, resample_film
from flowsculpt.pipeline.flow import Flow, Streamlines, Sum
from flowsculpt.pipeline.flow.catalogue.basic import Expansion
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.resample import Resampler, Thresholds

SWELLING, SHRINKING, RADIUS = (0.36, 0.36, 0.0), (-0.36, -0.36, 0.0), 0.62
FRAMES, MESHES, LONGEST = 28, 24, 0.125


def quads(meshes: int = MESHES) -> PolygonMesh:
    """Return a square of side 2 in the plane z = 0, of that many quads along a side."""
    line = np.linspace(-1, 1, meshes + 1)
    points = np.array([(x, y, 0.0) for y in line for x in line])
    first = np.array([i + j * (meshes + 1) for j in range(meshes) for i in range(meshes)])
    return PolygonMesh(points, list(first[:, None] + [0, 1, meshes + 2, meshes + 1]))


def discs(rate: float = 2.2) -> Flow:
    """Return a flow in which one disc expands and the other contracts at the same rate."""
    return Streamlines(
        Sum(
            (
                Expansion(shape="disc", centre=SWELLING, radius=RADIUS, rate=rate),
                Expansion(shape="disc", centre=SHRINKING, radius=RADIUS, rate=-rate),
            )
        )
    )


def three_versions(frames: int = FRAMES) -> tuple[PolygonMesh, PolygonMesh, TriangleMesh]:
    """Return the last frame: static, resampled with arbitrary faces, resampled as triangles."""
    sheet, flow, thresholds = quads(), discs(), Thresholds(LONGEST)
    (moved,) = deque(displace_film(sheet.vertices, flow, frames), maxlen=1)
    arbitrary = PolyhedralResampler(sheet, thresholds)
    triangles = Resampler(sheet.triangulated(), thresholds)
    deque(resample_film(arbitrary, flow, frames), maxlen=0)
    deque(resample_film(triangles, flow, frames), maxlen=0)
    return sheet.with_vertices(moved), arbitrary.mesh, triangles.mesh


def draw() -> None:
    from matplotlib.patches import Circle

    titles = ("B1  static mesh", "B2  arbitrary faces", "B3  triangles")
    figure, panels = page(titles, height=3.3, drawings=True)
    meshes: list[PolygonMesh | TriangleMesh] = [*three_versions()]
    for panel, mesh in zip(panels, meshes, strict=True):
        draw_edge_lines(panel, mesh, 0.45)
        for centre, colour in ((SWELLING, WARM), (SHRINKING, COOL)):
            panel.add_patch(Circle(centre[:2], RADIUS, color=colour, alpha=0.16, linewidth=0, zorder=3))
    save(figure, "figure_b.svg")


if __name__ == "__main__":
    draw()
