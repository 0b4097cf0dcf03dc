"""`python -m benchmarks.subjects [ROUNDS]`: CPU time of two subjects in one shot, against one shot for each.

Four pairs under one twist and flows of their own: two solids, a large one and a small one, a solid and a
cloud of points, and two clouds. The jobs of the stages `simulate` and `smooth_normals` run in this process,
on one thread, for the shot of both and for the two shots of one, in turns. CPU seconds of all jobs: medians
of rounds, after one that does not count. Then COPIES of a ball, against as many times one. Writes
`benchmarks/out/subjects.json`.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numba

from benchmarks.play import warm
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of

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
VORTEX = "flows: [{vortex: {strength: 2, radius: 0.5}}]"
BALL = f"{{solid: icosphere, radius: 0.6, {VORTEX}}}"
LARGE = "{solid: icosphere, radius: 1.5}"
SMALL = "{solid: box, size: [0.3, 0.3, 0.3]}"
POINTS = "count: 20000, radius: 0.011"
CLOUD = f"{{cloud: {{solid: icosphere, radius: 0.75}}, {POINTS}, {VORTEX}}}"
BLOCK = f"{{cloud: {{solid: box, size: [1, 1, 1]}}, {POINTS}}}"
MANY = "{solid: icosphere, radius: 0.3, copies: {count: {}, region: {box: {size: [9, 9, 9]}}}}"

Subjects = Mapping[str, str]

PAIRS: Mapping[str, Subjects] = {
    "cube, ball": {"cube": CUBE, "ball": BALL},
    "large ball, small cube": {"ball": LARGE, "cube": SMALL},
    "cube, cloud": {"cube": CUBE, "cloud": CLOUD},
    "two clouds": {"cloud": CLOUD, "block": BLOCK},
}


def main(rounds: int = ROUNDS) -> None:
    """Measure all shots and print the rows."""
    numba.set_num_threads(1)
    warm()
    rows: list[Row] = []
    for name, pair in PAIRS.items():
        together, *alone = medians([pair, *({subject: entry} for subject, entry in pair.items())], rounds)
        rows.append({"subjects": name, "each alone, CPU s": ", ".join(f"{cost:.2f}" for cost in alone)})
        rows[-1] |= {"together, CPU s": together, "of the sum": together / sum(alone)}
    one, many = medians([{"ball": MANY.replace("{}", str(count))} for count in (1, COPIES)], rounds)
    rows.append({"subjects": f"{COPIES} copies of a small ball", "each alone, CPU s": f"{one:.2f}"})
    rows[-1] |= {"together, CPU s": many, "of the sum": many / (COPIES * one)}
    keep("subjects", rows)
    show("Simulating 16 frames and smoothing their normals, one thread", rows)


def medians(shots: Sequence[Subjects], rounds: int) -> list[float]:
    """Return the CPU seconds of each shot, which take turns."""
    measured = [[made(subjects) for subjects in shots] for _ in range(rounds + 1)]
    return [statistics.median(seconds) for seconds in zip(*measured[1:], strict=True)]  # the first compiles


def made(subjects: Subjects) -> float:
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
