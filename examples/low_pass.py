"""Collapsing is a low-pass filter (P28): without hard edges a cube becomes a ball."""

from __future__ import annotations

import math

from examples.drawing import COOL, GREY, WARM, page, save
from examples.film import resample_film, sphericity
from flowsculpt.pipeline.flow import Flow, Sequence, keyed
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.mesh import TriangleMesh, box
from flowsculpt.pipeline.resample import Resampler, Thresholds

EDGE, LONGEST, ROUNDS = 0.3, 0.4, 12
AXES = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
ROUND = 72
"""Frames: one axis after the other, a second each."""


def twists_and_back(rounds: int) -> Flow:
    """Return a twist about each axis in turn, and back: the exact surface is a cube again each second."""

    def about(place: int) -> Twist:
        starts = [3 * n + place for n in range(rounds)]
        times = tuple(start + step for start in starts for step in (0.0, 0.5, 1.0))
        return Twist(axis=AXES[place], amount=keyed(times, (0.0, 1.0, 0.0) * rounds))

    return Sequence(tuple(about(place) for place in range(3)))


def twist_cube(hard_angle: float, rounds: int = ROUNDS) -> tuple[TriangleMesh, list[float]]:
    """Return the cube after that many rounds, and its sphericity after each; `hard_angle` in radians."""
    resampler = Resampler(box(edge_length=EDGE), Thresholds(LONGEST, hard_angle=hard_angle))
    values = [
        sphericity(resampler.mesh)
        for frame, _ in enumerate(resample_film(resampler, twists_and_back(rounds), rounds * ROUND))
        if frame % ROUND == 0
    ]
    return resampler.mesh, values


def draw() -> None:
    from examples.shading import draw_edges, frame_mesh, render_mesh, show

    titles = ("edges over 40° are hard", "no edge is hard", "sphericity")
    figure, panels = page(titles, height=3.3)
    framing = frame_mesh(box(edge_length=1.0), azimuth=-28, elevation=20, aspect=1.0)
    for panel, angle, colour in zip(panels, (math.radians(40), math.pi), (COOL, WARM), strict=False):
        mesh, values = twist_cube(angle)
        picture = render_mesh(mesh, framing, (620, 620))
        show(panel, picture)
        draw_edges(panel, picture, mesh)
        panels[2].plot(values, color=colour)
    panels[2].set(xlabel="rounds of three twists", ylim=(0.78, 1.02))
    for name, level in (("ball", 1.0), ("cube", (math.pi / 6) ** (1 / 3))):
        panels[2].axhline(level, linewidth=0.8, color=GREY, dashes=(4, 3))
        above = name == "ball"
        panels[2].text(ROUNDS, level, name, fontsize=8, ha="right", va="bottom" if above else "top")
    save(figure, "low_pass.png")


if __name__ == "__main__":
    draw()
