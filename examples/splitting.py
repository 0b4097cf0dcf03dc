"""Other ways to place samples (P26): cutting faces into four, and density that follows the curvature."""

from __future__ import annotations

import math

import numpy as np

from examples.density import LONGEST, SUBJECT, vortex_flow
from examples.drawing import COOL, WARM, page, save
from examples.film import edge_lengths, resample_film
from examples.placements import centres, distances, simulate
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.resample import Curvature, Report, Resampler, Thresholds
from flowsculpt.pipeline.resample.resampler import Splits

FRAMES, STIRRED = 240, 45
UNIFORM = (0.3, 0.2, 0.14, 0.1)
"""Maximum edge lengths."""
TOLERANCES = (0.02, 0.01, 0.005, 0.0025)
"""Largest distance of an edge from the surface, scene units."""


def split(splits: Splits, frames: int = FRAMES) -> tuple[list[Report], Floats]:
    """Return the reports of the ball of the density film, and its edge lengths at the end."""
    resampler = Resampler(SUBJECT, Thresholds(LONGEST), splits=splits)
    reports = list(resample_film(resampler, vortex_flow(), frames))
    return reports, edge_lengths(resampler.mesh)


def size_and_error(thresholds: Thresholds, frames: int = STIRRED) -> tuple[int, float]:
    """Return the vertices of a deformed ball, and the distance of its face centres from the exact surface.

    The distance is the 99th percentile, scene units.
    """
    *_, (frame, mesh) = simulate("exact", thresholds, frames)
    return len(mesh.vertices), float(np.percentile(np.abs(distances(centres(mesh), frame)), 99))


def by_curvature(tolerance: float) -> Thresholds:
    """Return a density that follows the curvature, everywhere on a surface without creases."""
    return Thresholds(Curvature(tolerance, finest=0.03, coarsest=0.5, hard_angle=math.pi))


def draw() -> None:
    figure, (lengths, errors) = page(("edges cut in two, faces in four", "uniform, by curvature"), height=3.3)
    colours: dict[Splits, str] = {"edges": COOL, "faces": WARM}
    for splits, colour in colours.items():
        reports, sides = split(splits)
        counted, borders = np.histogram(sides / LONGEST, np.linspace(0.2, 1.0, 41))
        name = f"{splits}: {reports[-1].vertices} vertices"
        lengths.stairs(100 * counted / len(sides), borders, color=colour, label=name, linewidth=1.6)
    lengths.set(xlabel="edge length / maximum", ylabel="% of the edges", xlim=(0.2, 1.0), ylim=(0, None))
    lengths.legend()
    for name, colour, all_thresholds in (
        ("uniform", WARM, [Thresholds(longest) for longest in UNIFORM]),
        ("by curvature", COOL, [by_curvature(tolerance) for tolerance in TOLERANCES]),
    ):
        points = np.array([size_and_error(thresholds) for thresholds in all_thresholds])
        errors.loglog(*points.T, color=colour, label=name, marker="o", markersize=4.5)
    errors.set(xlabel="vertices", ylabel="99th percentile of the distance")
    errors.set_xticks([1000, 2000, 4000, 8000], ["1000", "2000", "4000", "8000"])
    errors.set_yticks([0.002, 0.005, 0.01, 0.02], ["0.002", "0.005", "0.01", "0.02"])
    errors.minorticks_off()
    errors.legend()
    save(figure, "splitting.svg")


if __name__ == "__main__":
    draw()
