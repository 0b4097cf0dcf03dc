"""Figure A: a polyhedron in flow, with and without adaptive resampling (P14)."""

from __future__ import annotations

from collections import deque

from examples.drawing import page, save
from examples.film import displace_film, resample_film
from flowsculpt.pipeline.flow import Flow, Streamlines, Sum
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.mesh import TriangleMesh, box
from flowsculpt.pipeline.resample import Resampler, Thresholds

FRAMES, EDGE, LONGEST = 34, 0.25, 0.2
SIZE = (940, 610)


def vortex_flow() -> Flow:
    """Return two vortices that turn against each other, and a third across them."""
    pair = [Vortex(centre=(0.9 * side, 0.3, 0.0), radius=0.8, strength=7.6 * side) for side in (1, -1)]
    return Streamlines(Sum((*pair, Vortex(axis=(0.0, 1.0, 0.0), radius=1.2, strength=4.0))))


def with_and_without(frames: int = FRAMES) -> tuple[TriangleMesh, TriangleMesh]:
    """Return the cube's last frame, without resampling and with."""
    cube, flow = box(edge_length=EDGE), vortex_flow()
    (moved,) = deque(displace_film(cube.vertices, flow, frames), maxlen=1)
    resampler = Resampler(cube, Thresholds(LONGEST))
    deque(resample_film(resampler, flow, frames), maxlen=0)
    return cube.with_vertices(moved), resampler.mesh


def draw() -> None:
    from examples.shading import draw_edges, frame_mesh, render_mesh, show

    static, adaptive = with_and_without()
    figure, panels = page(("without resampling", "with resampling"), height=3.4, drawings=True)
    framing = frame_mesh(adaptive, azimuth=-24, elevation=22, aspect=SIZE[0] / SIZE[1])
    for panel, mesh in zip(panels, (static, adaptive), strict=True):
        picture = render_mesh(mesh, framing, SIZE)
        show(panel, picture)
        draw_edges(panel, picture, mesh)
    save(figure, "figure_a.png")


if __name__ == "__main__":
    draw()
