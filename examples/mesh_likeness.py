"""Mesh-likeness (P7): short edges and flat angles, frame after frame."""

from __future__ import annotations

import math

import numpy as np

from examples.density import LONGEST, SUBJECT, vortex_flow
from examples.drawing import COOL, WARM, page, save
from examples.film import displace_film, resample_film
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.resample import Resampler, Thresholds
from flowsculpt.pipeline.statistics import mesh_statistics

FRAMES = 360


def likeness(mesh: TriangleMesh) -> tuple[float, float]:
    """Return mean edge over diameter, and the median angle between neighbouring faces, degrees."""
    found = mesh_statistics(mesh)
    return found.mean_edge / found.diameter, math.degrees(found.median_dihedral)


def with_and_without(frames: int = FRAMES) -> tuple[Floats, Floats]:
    """Return `likeness` (frames + 1, 2), without resampling and with."""
    flow, resampler = vortex_flow(), Resampler(SUBJECT, Thresholds(LONGEST))
    moved = displace_film(SUBJECT.vertices, flow, frames)
    static = [likeness(SUBJECT.with_vertices(points)) for points in moved]
    adaptive = [likeness(resampler.mesh) for _ in resample_film(resampler, flow, frames)]
    return np.array(static), np.array(adaptive)


def draw() -> None:
    figure, panels = page(("mean edge / diameter", "median angle between faces, degrees"), height=2.9)
    for name, colour, rows in zip(
        ("without resampling", "with"), (WARM, COOL), with_and_without(), strict=True
    ):
        for panel, values in zip(panels, rows.T, strict=True):
            panel.plot(values, color=colour, label=name)
    panels[0].set_ylim(0)
    panels[1].set_ylim(top=180)
    for panel in panels:
        panel.set_xlabel("frame")
    panels[0].legend()
    save(figure, "mesh_likeness.svg")


if __name__ == "__main__":
    draw()
