"""`python -m benchmarks.simulation [EDGE FRAMES …]`: CPU time of simulating a cube in a vortex pair.

The flows are those of the shot A010_cube at their full strength. Two settings run side by side, a frame of
one after a frame of the other: sub-steps of at most half an edge and crossings counted in every frame, as
all shots had until they took their sub-steps from the flow alone; and today's. CPU seconds of a frame on one
thread: median, and the quartiles as the spread. Writes `benchmarks/out/simulation.json`.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np

from benchmarks.play import warm
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.statistics import mesh_statistics

SHOT = """\
title: Cube in a pair of vortices
frames: 1-{last}
rate: 24
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: {edge}, max_vertices: 20000000}}
flows:
  - sum:
      - vortex: {{axis: z, centre: [0.9, 0.3, 0], radius: 0.8, strength: 7.6}}
      - vortex: {{axis: z, centre: [-0.9, 0.3, 0], radius: 0.8, strength: -7.6}}
      - translation: {{rate: [0, 1.07, 0]}}
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, {last}: {twist}}}}}}}
look: clay
{more}
"""

SIZES = ((0.075, 33), (0.0235, 9), (0.0083, 4))
"""Maximum edge lengths, and the frames of each after the first."""

TWIST = 80 / 56
"""Degrees a unit and a frame."""

SETTINGS = {"half an edge": "max_step: 0.5", "now": ""}


def main(sizes: tuple[tuple[float, int], ...] = SIZES) -> None:
    """Measure all sizes and print the rows."""
    numba.set_num_threads(1)
    warm()
    rows = [row for edge, frames in sizes for row in measure(edge, frames)]
    keep("simulation", rows)
    show("Simulating a cube, CPU seconds a frame, one thread", rows)


def measure(edge: float, frames: int) -> Iterator[Row]:
    """Yield a row for each setting, with a maximum edge length and so many frames after the first."""
    films = {name: simulated(edge, frames, more) for name, more in SETTINGS.items()}
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in films}
    vertices = dict.fromkeys(films, 0)
    for number in range(frames + 1):
        for name, film in films.items():
            started = time.process_time()
            frame = next(film)
            moved = time.process_time()
            take_statistics(frame, count_all=name != "now")
            if number:  # the first one makes the subject
                spent[name].append((moved - started, time.process_time() - moved))
            vertices[name] = len(frame.mesh.vertices)
    for name in films:
        moved, statistics = np.array(spent[name]).T
        low, middle, high = np.quantile(moved + statistics, (0.25, 0.5, 0.75))
        yield {
            "steps": name,
            "vertices at the end": float(vertices[name]),
            "frames": float(frames),
            "median": float(middle),
            "quartiles": f"{low:.3g}–{high:.3g}",
            "mean": float((moved + statistics).mean()),
            "statistics, mean": float(statistics.mean()),
        }


def simulated(edge: float, frames: int, more: str) -> Iterator[MeshFrame]:
    """Return the frames of the shot, simulated as they are taken."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.yaml"
        path.write_text(SHOT.format(last=frames + 1, twist=TWIST * frames, edge=edge, more=more))
        return animate(read_shot(path))


def take_statistics(frame: MeshFrame, count_all: bool) -> None:
    """Compute a frame's statistics: those of its report, or with crossings whatever its number is."""
    if count_all:
        mesh_statistics(frame.mesh)
    else:
        assert frame.report.statistics is not None


if __name__ == "__main__":
    given = sys.argv[1:]
    pairs = tuple((float(edge), int(count)) for edge, count in zip(given[::2], given[1::2], strict=True))
    main(pairs or SIZES)
