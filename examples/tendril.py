"""A tendril thinner than the minimum edge survives as a tube of three sides (P32)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from examples.drawing import COOL, WARM, outline, page, save
from examples.film import RATE, resample_film, volume
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.basic import Strain
from flowsculpt.pipeline.mesh import TriangleMesh, rod
from flowsculpt.pipeline.resample import Resampler, Thresholds

FRAMES, LONGEST, RADIUS, PULL = 72, 0.1, 0.15, 1.5
FLOW = Streamlines(Strain(rate=PULL))
"""Stretches along y and keeps volume."""

HARD, NONE = math.radians(40), math.pi
VIEW = np.array([[0.0, 0.5], [1.0, 0.0], [0.0, 0.87]])
"""The rod on its side, seen from above."""


class PulledRod(NamedTuple):
    """A rod at the end, and after each frame the shares of its volume and of the exact length it has kept."""

    mesh: TriangleMesh
    volumes: list[float]
    lengths: list[float]


def pull_rod(hard_angle: float, frames: int = FRAMES) -> PulledRod:
    """Pull a round rod to many times its length; `hard_angle` in radians."""
    resampler = Resampler(
        rod(length=1.2, radius=RADIUS, edge_length=0.07), Thresholds(LONGEST, hard_angle=hard_angle)
    )
    volumes, lengths = [], []
    for frame, _ in enumerate(resample_film(resampler, FLOW, frames)):
        volumes.append(volume(resampler.mesh))
        lengths.append(float(np.ptp(resampler.vertices[:, 1])) / (1.2 * math.exp(PULL * frame / RATE)))
    return PulledRod(resampler.mesh, [v / volumes[0] for v in volumes], lengths)


def middle(mesh: TriangleMesh, half: float = 0.55) -> TriangleMesh:
    """Return the faces within a distance of the plane y = 0."""
    near = (np.abs(mesh.vertices[mesh.faces][:, :, 1]) < half).all(axis=1)
    return TriangleMesh(mesh.vertices, mesh.faces[near])


def draw() -> None:
    figure, (left, right) = page(("", "volume kept"), height=3.0)
    left.set_aspect("equal", anchor="NW")
    left.set_axis_off()
    ways = (("edges over 40° are hard", HARD, COOL), ("no edge is hard", NONE, WARM))
    for place, (name, angle, colour) in enumerate(ways):
        rod_now = pull_rod(angle)
        part = middle(rod_now.mesh)
        outline(left, part.with_vertices(part.vertices - [0, 0, 0.36 * place]), VIEW, edgecolors=colour)
        left.text(-0.55, 0.1 - 0.313 * place, name)
        right.plot(rod_now.volumes, color=colour, label=name)
    left.plot([-0.55, -0.55 + 0.4 * LONGEST], [-0.47, -0.47], color="black", linewidth=1.2)
    left.text(-0.49, -0.47, "the minimum edge", va="center", fontsize=8)
    right.set(xlabel="frame", ylim=(0, 1.05))
    right.legend(loc="lower left")
    save(figure, "tendril.svg")


if __name__ == "__main__":
    draw()
