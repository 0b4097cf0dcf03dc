"""`python -m benchmarks.orientations [FILM ...]`: films with exact placement, in eight orientations.

A film that folds its surface magnifies every difference: the same ball turned gives a tenth or ten times the
faces that end the wrong way round. So each film runs with its subject turned in eight ways, and the rows hold
the median and the range of all. Distances are rms of vertices and face centres, in maximum edge lengths; CPU
seconds are of all frames. `crossings` are pairs of faces that intersect at the end.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.enright import DENSITY
from benchmarks.films import density
from benchmarks.measures import exactness, quality, volume
from benchmarks.play import play, warm, with_normals
from benchmarks.report import Row, keep, show
from benchmarks.works import Film, abc, enright, lorenz, turned
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.statistics import self_intersections

ORIENTATIONS = 8
ALL = 1 << 30


@dataclass(frozen=True)
class Work:
    """A film, the thresholds if they follow curvature, and the frame at half time if its error counts."""

    film: Callable[[], Film]
    thresholds: Callable[[Film], Thresholds] | None = None
    half: int = 0


WORKS = {
    "lorenz": Work(lorenz),
    "lorenz, rims half as long": Work(lorenz, lambda film: density(film.max_edge_length, 0.46)),
    "lorenz, rims a quarter": Work(lorenz, lambda film: density(film.max_edge_length)),
    "enright": Work(enright, half=75),
    "enright, curvature": Work(enright, lambda film: DENSITY, half=75),
    "abc": Work(abc),
    "abc, rims half as long": Work(abc, lambda film: density(film.max_edge_length, 0.46)),
}


def main(names: list[str]) -> None:
    """Print the median and the range of every measure."""
    warm()
    rows: list[Row] = []
    for name in names or WORKS:
        found = [measure(WORKS[name], seed) for seed in range(ORIENTATIONS)]
        rows += [{"film": name, **row} for row in summary(found)]
        show(f"{name}: medians of {ORIENTATIONS} orientations", summary(found))
    keep("orientations", rows)


def summary(found: list[dict[str, float]]) -> list[Row]:
    """Return one row a measure: its median, least and most."""
    return [
        {
            "measure": what,
            "median": float(np.median([one[what] for one in found])),
            "least": min(one[what] for one in found),
            "most": max(one[what] for one in found),
        }
        for what in found[0]
    ]


def measure(work: Work, seed: int) -> dict[str, float]:
    """Run one film to its end."""
    film = turned(work.film(), seed)
    film = film if work.thresholds is None else with_normals(film)
    thresholds = None if work.thresholds is None else work.thresholds(film)
    edges = out = peak = on_chord = splits = 0
    middle: dict[str, float] = {}
    started = time.process_time()
    for moment in play(film, "exact", thresholds):
        report = moment.report
        edges, out = edges + report.edges, out + report.too_short
        on_chord, splits, peak = (
            on_chord + report.on_chord,
            splits + report.splits,
            max(peak, report.vertices),
        )
        if moment.number == work.half:
            middle = {
                "surface rms at half time": exactness(film, moment.after(), work.half, ALL)["surface rms"]
            }
    seconds = time.process_time() - started
    mesh = moment.after()
    validate(mesh).require(closed=True)
    kept = volume(mesh) / (volume(film.subject) * math.exp(film.swells))
    exact = exactness(film, mesh, film.frames, ALL)
    return {
        "% flipped": exact["% flipped"],
        "crossings": float(self_intersections(mesh)),
        "volume %": 100 * (kept - 1),
        "% within limits": 100 * (1 - out / edges),
        "surface rms": exact["surface rms"],
        **middle,
        "quality 1%": float(np.quantile(quality(mesh), 0.01)),
        "vertices": float(len(mesh.vertices)),
        "most vertices": float(peak),
        "% on chord": 100 * on_chord / max(1, splits),
        "resampling, s": moment.seconds,
        "all, CPU s": seconds,
    }


if __name__ == "__main__":
    main(sys.argv[1:])
