"""How mesh-like a surface stays (P7): short edges, flat angles, frame after frame."""

from __future__ import annotations

import math

import numpy as np

from examples.density import LONGEST, SUBJECT, stirring
from examples.drawing import COOL, WARM, page, save
from examples.film import resampled, unresampled
from pipeline.arrays import Floats
from pipeline.mesh import TriangleMesh
from pipeline.resample import Resampler, Thresholds
from pipeline.statistics import mesh_statistics

FRAMES = 360


def likeness(mesh: TriangleMesh) -> tuple[float, float]:
    """Mean edge over diameter, and the median angle between neighbouring faces, degrees."""
    found = mesh_statistics(mesh)
    return found.mean_edge / found.diameter, math.degrees(found.median_dihedral)


def both_ways(frames: int = FRAMES) -> tuple[Floats, Floats]:
    """(frames + 1, 2) of `likeness`, without resampling and with."""
    flow, resampler = stirring(), Resampler(SUBJECT, Thresholds(LONGEST))
    moved = unresampled(SUBJECT.vertices, flow, frames)
    static = [likeness(SUBJECT.with_vertices(points)) for points in moved]
    adaptive = [likeness(resampler.mesh) for _ in resampled(resampler, flow, frames)]
    return np.array(static), np.array(adaptive)


def draw() -> None:
    figure, panels = page(("mean edge / diameter", "median angle between faces, degrees"), height=2.9)
    for name, colour, rows in zip(("without resampling", "with"), (WARM, COOL), both_ways(), strict=True):
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
