"""`python -m benchmarks.subjects [ROUNDS]`: CPU time of two subjects in one shot, against one shot for each.

A cube and a ball under one twist and a flow of their own. The jobs of the stages `simulate` and
`smooth_normals` run in this process, on one thread, for the shot of both and for the two shots of one, in
turns. CPU seconds of all jobs: medians of rounds, after one that does not count. Then COPIES of a ball,
against as many times one. Writes `benchmarks/out/subjects.json`.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numba

from benchmarks.play import warm
from benchmarks.report import Row, keep, show
from pipeline.production.execution.project import Project
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.worker import task_of

ROUNDS = 7
COPIES = 12

HEAD = """\
title: T
frames: 1-16
resample: {max_edge_length: 0.04}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 16: 60}}}
"""
CUBE = "{solid: box, size: [1, 1, 1], flows: [{stretch: {amount: {keys: {1: 1, 16: 1.3}}}}]}"
BALL = "{solid: icosphere, radius: 0.6, flows: [{vortex: {strength: 2, radius: 0.5}}]}"
REGION = "{box: {size: [9, 9, 9]}}"
MANY = f"{{solid: icosphere, radius: 0.3, copies: {{count: {{}}, region: {REGION}}}}}"

SUBJECTS: Mapping[str, Mapping[str, str]] = {
    "cube alone": {"cube": CUBE},
    "ball alone": {"ball": BALL},
    "both": {"cube": CUBE, "ball": BALL},
    "one small ball": {"ball": MANY.replace("{}", "1")},
    f"{COPIES} copies of it": {"ball": MANY.replace("{}", str(COPIES))},
}


def main(rounds: int = ROUNDS) -> None:
    """Measure all shots and print the rows."""
    numba.set_num_threads(1)
    warm()
    spent: dict[str, list[float]] = {name: [] for name in SUBJECTS}
    for number in range(rounds + 1):
        for name, subjects in SUBJECTS.items():
            seconds = made(subjects)
            if number:  # the first one compiles
                spent[name].append(seconds)
    medians = {name: statistics.median(seconds) for name, seconds in spent.items()}
    sums = {"both": medians["cube alone"] + medians["ball alone"]}
    sums[f"{COPIES} copies of it"] = COPIES * medians["one small ball"]
    rows: list[Row] = []
    for name, median in medians.items():
        row: Row = {"subjects": name, "CPU seconds": median}
        rows.append(row | ({"of the sum": median / sums[name]} if name in sums else {}))
    keep("subjects", rows)
    show("Simulating 16 frames and smoothing their normals, one thread", rows)


def made(subjects: Mapping[str, str]) -> float:
    """Return the CPU seconds of the jobs that make the meshes and normals of a shot."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        entries = "".join(f"  {name}: {entry}\n" for name, entry in subjects.items())
        (root / "shot.yaml").write_text(f"{HEAD}subjects:\n{entries}")
        project = Project(root, 1)
        planner = project.planner()
        planner.surfaces(project.request(root / "shot.yaml", "draft", variant="none"))
        plan = planner.plan()
        started = time.process_time()
        for job in plan.jobs:
            if job.stage in ("simulate", "smooth_normals"):
                assert task_of(job.stage)(Context.of(root, plan, job.name)), job.name
        return time.process_time() - started


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
