"""`python -m benchmarks.frames`: one frame, against a memory-bound pass over its edges, and other remeshers.

Every size is measured in a process of its own for each number of threads. The edge pass, always of one
thread, is measured in the same process, before and after.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import numpy as np

from benchmarks import peers, works
from benchmarks.limit import best_of, edge_pass
from benchmarks.measures import edges_of, told
from benchmarks.play import warm
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.resample import Resampler, Thresholds

REPEATS = 7
PASSES = 40
PEER_SIZE = "160k"
MOST_PASSES = {"40k": 12.0, "160k": 12.0, "640k": 10.0}
"""The targets: multiples of the edge pass, one thread."""


def main() -> list[Target]:
    """Measure all sizes; return the targets."""
    rows = [
        _apart(size, kind, threads)
        for kind in works.KINDS
        for size in works.FREQUENCIES
        for threads in (1, 2)
    ]
    against = compare()
    keep("frames", rows)
    keep("peers", against)
    show("One frame, 5% of its edges outside the length limits", rows)
    show(f"The same at {PEER_SIZE} by others, one iteration", against)
    return targets(rows, against)


def measure(size: str, kind: str, threads: int) -> Row:
    """Measure one resampling of a frame and the edge pass, in this process."""
    mesh, longest = works.frame(size, kind)
    edges = edges_of(mesh.faces)
    warm()
    before = best_of(lambda: edge_pass(mesh.vertices, edges, longest**2), PASSES)
    runs = [once(mesh, longest) for _ in range(REPEATS)]
    first, _ = min(once(mesh, longest, unsorted=len(mesh.vertices)) for _ in range(REPEATS))
    after = best_of(lambda: edge_pass(mesh.vertices, edges, longest**2), PASSES)
    limit, (seconds, operations) = min(before, after), min(runs)
    return {
        "vertices": size,
        "5% of edges": kind,
        "threads": threads,
        "ms": 1e3 * seconds,
        "first frame, ms": 1e3 * first,
        "edge pass, ms": 1e3 * limit,
        "x edge pass": seconds / limit,
        "operations": operations,
        "µs each": 1e6 * seconds / operations,
    }


def once(mesh: TriangleMesh, longest: float, unsorted: int = 0) -> tuple[float, int]:
    """Return the seconds of one resampling, its splits, collapses and flips. Connectivity is built before.

    unsorted  vertices that are new since the last sort: none in the middle of a film; in a film's first
              frame all, which are sorted at its end
    """
    thresholds = Thresholds(longest)
    state = Resampler(mesh, thresholds).state() | {"unsorted": np.array(unsorted)}
    resampler = Resampler.from_state(state, thresholds)
    start = time.perf_counter()
    report = resampler.resample()
    return time.perf_counter() - start, report.splits + report.collapses + report.flips


def compare() -> list[Row]:
    """Return the installed remeshers, and their times over ours."""
    mesh, longest = works.frame(PEER_SIZE, "too long")
    ours = min(once(mesh, longest)[0] for _ in range(REPEATS))
    rows: list[Row] = [{"remesher": "flowsculpt", "ms": 1e3 * ours, "times ours": 1.0}]
    for name, remesh in peers.installed().items():
        seconds = remesh(mesh, longest)[1]
        rows.append({"remesher": name, "ms": 1e3 * seconds, "times ours": seconds / ours})
    return rows


def targets(rows: list[Row], against: list[Row]) -> list[Target]:
    """Return the targets of single frames."""
    found = {(row["vertices"], row["5% of edges"], row["threads"]): row for row in rows}
    wanted = []
    for kind in works.KINDS:
        for size, most in MOST_PASSES.items():
            passes = told(found[size, kind, 1], "x edge pass")
            wanted.append(Target(f"frame:{size}, {kind}", "x edge pass", passes, most=most))
    for row in against[1:]:
        wanted.append(
            Target(f"frame:{PEER_SIZE}, {row['remesher']}", "times ours", told(row, "times ours"), least=150)
        )
    return wanted


def _apart(size: str, kind: str, threads: int) -> Row:
    """Run `measure` in a process with so many threads."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.frames", size, kind, str(threads)],
        env={**os.environ, "NUMBA_NUM_THREADS": str(threads)},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    row: Row = json.loads(done.stdout)
    return row


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(sys.argv[1], sys.argv[2], int(sys.argv[3]))))
    else:
        show("Targets", [target.row for target in main()])
