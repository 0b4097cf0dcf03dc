"""Figure A: a polyhedron in flow, with and without adaptive resampling (P14)."""

from __future__ import annotations

from collections import deque

from examples.drawing import page, save
from examples.film import resampled, unresampled
from pipeline.flow import Flow, Sequence, Streamlines, Sum
from pipeline.flow.catalogue import Twist, Vortex
from pipeline.mesh import TriangleMesh, box
from pipeline.resample import Resampler, Thresholds

FRAMES, EDGE, LONGEST = 30, 0.2, 0.2
SIZE = (470, 470)


def stirring() -> Flow:
    """Two vortices that turn against each other."""
    return Streamlines(
        Sum(
            tuple(
                Vortex(centre=(0.9 * side, 0.3, 0.0), radius=0.8, strength=7.0 * side, profile="gaussian")
                for side in (1, -1)
            )
        )
    )


def both_ways(frames: int = FRAMES) -> tuple[TriangleMesh, TriangleMesh]:
    """The cube's last frame, without resampling and with."""
    cube, flow = box(edge_length=EDGE), stirring()
    (moved,) = deque(unresampled(cube.vertices, flow, frames), maxlen=1)
    resampler = Resampler(cube, Thresholds(LONGEST))
    deque(resampled(resampler, flow, frames), maxlen=0)
    return cube.with_vertices(moved), resampler.mesh


def draw() -> None:
    from examples.shading import framed, photograph, show, wires

    static, adaptive = both_ways()
    figure, panels = page(("without resampling", "with resampling"), height=5.0, drawings=True)
    framing = framed(adaptive, azimuth=-24, elevation=18, aspect=1.0)
    for panel, mesh in zip(panels, (static, adaptive), strict=True):
        picture = photograph(mesh, framing, SIZE)
        show(panel, picture)
        wires(panel, picture, mesh)
    save(figure, "figure_a.png")


if __name__ == "__main__":
    draw()
