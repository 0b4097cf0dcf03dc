"""`python -m benchmarks.memory`: peak memory of resampling five million vertices; of stages.

A process of its own records its size, loads the mesh from a file, resamples it and records its peak size. The
difference over the vertices is what mesh and resampler need together.

`python -m benchmarks.memory stages` renders six frames of A020_lorenz at daily and, with four samples, at
final, both denoised over time, and shows the largest resident sizes of all processes and of renderers: where
memory is short (psutil reports 3 GB as free to every process), and with what this machine has.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from shutil import copytree

import numpy as np
import psutil

from benchmarks.measures import edges_of, lengths_of, told
from benchmarks.play import warm
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.resample import Resampler, Thresholds

FREQUENCY = 708
"""Frequency of the geodesic sphere: 10 n² + 2 vertices, 5,012,642."""

MOST_BYTES = 250.0

MOST_MB = {"daily, short": 800.0, "final, short": 1500.0, "final": 2200.0}
"""Targets: the largest process."""

SHORT = """
import psutil
real = psutil.virtual_memory
psutil.virtual_memory = lambda: real()._replace(available=3_000_000_000)
"""
"""What Python runs first in every process where memory is short."""

SHOTS = Path(__file__).parents[1] / "shots"


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


def stages() -> list[Target]:
    """Measure the processes of a daily and of a final; return the targets."""
    cases = (("daily", "16", True), ("final", "4", True), ("final", "4", False))
    rows = [_stages(*each) for each in cases]
    keep("memory_stages", rows)
    show("Largest processes, MB", rows)
    largest = {str(row["quality"]): told(row, "largest") for row in rows}
    return [Target(name, "MB, largest process", size, most=MOST_MB[name]) for name, size in largest.items()]


def _stages(quality: str, samples: str, is_short: bool) -> Row:
    """Return the peak resident sizes of the largest process and of the largest renderer."""
    words = [
        "render",
        "A020_lorenz",
        "-f",
        "30-35",
        "-q",
        quality,
        "--set",
        f"quality.{quality}.samples={samples}",
    ]
    largest = 0
    with tempfile.TemporaryDirectory() as folder:
        copytree(SHOTS, Path(folder) / "shots")
        command = [sys.executable, "-m", "flowsculpt", "--no-progress", *words]
        (Path(folder) / "first").mkdir()
        (Path(folder) / "first" / "sitecustomize.py").write_text(SHORT if is_short else "", encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": f"{folder}/first"}
        with psutil.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL) as running:
            while running.poll() is None:
                for child in running.children(recursive=True):
                    with suppress(psutil.Error):
                        largest = max(largest, child.memory_info().rss)
                time.sleep(0.01)
        pictures = [
            json.loads(path.read_text()) for path in Path(folder).glob("renders/*/*/statistics/*.json")
        ]
    renderer = max(picture["peak_memory_mib"] for picture in pictures)
    return {
        "quality": quality + ", short" * is_short,
        "largest": largest / 1e6,
        "largest renderer": renderer * 1.048576,
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
    elif sys.argv[1:] == ["stages"]:
        show("Targets", [target.row for target in stages()])
    elif len(sys.argv) > 1:
        print(json.dumps(measure(Path(sys.argv[2]))))
    else:
        show("Targets", [target.row for target in main()])
