"""Figure F: a flow sculpture. The one of *Virtually Yours* is lost; this is a new one (P40)."""

from __future__ import annotations

from pathlib import Path

from examples.drawing import page, save
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import Stage

SHOT = Path(__file__).resolve().parent.parent / "shots" / "A010_cube.yaml"
FRAME, SIZE = 44, (1200, 675)


def sculpture(frame: int = FRAME) -> TriangleMesh:
    """Return the cube of the film's first shot, rolled up by two vortices."""
    return next(made.mesh for made in animate(read_shot(SHOT)) if made.number == frame)


def draw() -> None:
    from examples.shading import frame_mesh, render_mesh, show

    mesh = sculpture()
    figure, (panel,) = page(("",), height=5.4, drawings=True, bare=True)
    framing = frame_mesh(mesh, azimuth=14, elevation=15, aspect=SIZE[0] / SIZE[1], margin=0.12)
    picture = render_mesh(
        mesh, framing, SIZE, LOOKS["glaze"], LIGHTS["gallery"], Stage(), exposure=0.0, samples=64
    )
    show(panel, picture)
    save(figure, "figure_f.png")


if __name__ == "__main__":
    draw()
