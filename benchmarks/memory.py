"""`python -m benchmarks.memory`: peak memory of resampling five million vertices in one frame.

A process of its own records its size, loads the mesh from a file, resamples it and records its peak size. The
difference over the vertices is what mesh and resampler need together.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import psutil

from benchmarks.measures import edges_of, lengths_of, told
from benchmarks.play import warm
from benchmarks.report import Row, Target, keep, show
from pipeline.mesh import TriangleMesh, icosphere
from pipeline.resample import Resampler, Thresholds

FREQUENCY = 708
"""Frequency of the geodesic sphere: 10 n² + 2 vertices, 5,012,642."""

MOST_BYTES = 250.0


def main(frequency: int = FREQUENCY) -> list[Target]:
    """Measure peak memory; return the target."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frame.npz"
        subprocess.run(
            [sys.executable, "-m", "benchmarks.memory", "write", str(file), str(frequency)], check=True
        )
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.memory", "measure", str(file)],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
    row: Row = json.loads(done.stdout)
    keep("memory", [row])
    show("One frame of five million vertices", [row])
    return [Target("frame:5M", "bytes a vertex", told(row, "bytes a vertex"), most=MOST_BYTES)]


def write(file: Path, frequency: int) -> None:
    """Write a geodesic sphere, stretched around its equator until edges there are too long."""
    ball = icosphere(frequency)
    longest = float(lengths_of(ball.vertices, edges_of(ball.faces)).mean()) / math.sqrt(0.4)
    points = np.array(ball.vertices)
    points[:, 1] += 0.05 * np.tanh(points[:, 1] / 0.05)
    np.savez(file, vertices=points, faces=ball.faces, longest=longest)


def measure(file: Path) -> Row:
    """Measure in this process, which must be a fresh one."""
    warm()
    process = psutil.Process()
    before = process.memory_info().rss
    with _Peak(process) as peak, np.load(file) as saved:
        mesh, longest = TriangleMesh(saved["vertices"], saved["faces"]), float(saved["longest"])
        resampler = Resampler(mesh, Thresholds(longest, max_vertices=20_000_000))
        vertices = len(mesh.vertices)
        del mesh
        start = time.perf_counter()
        report = resampler.resample()
        seconds = time.perf_counter() - start
    return {
        "vertices before": vertices,
        "after": report.vertices,
        "splits": report.splits,
        "s": seconds,
        "MB before the mesh": before / 1e6,
        "MB at the peak": peak.most / 1e6,
        "bytes a vertex": (peak.most - before) / report.vertices,
    }


class _Peak:
    """Peak resident memory within the context, sampled a thousand times a second."""

    def __init__(self, process: psutil.Process) -> None:
        self._process, self.most, self._over = process, 0, threading.Event()
        self._watch = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> _Peak:
        self._watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._watch.join()

    def _look(self) -> None:
        while not self._over.wait(0.001):
            self.most = max(self.most, self._process.memory_info().rss)


if __name__ == "__main__":
    if len(sys.argv) > 1 and sys.argv[1] == "write":
        write(Path(sys.argv[2]), int(sys.argv[3]))
    elif len(sys.argv) > 1:
        print(json.dumps(measure(Path(sys.argv[2]))))
    else:
        show("Targets", [target.row for target in main()])
