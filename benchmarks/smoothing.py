"""`python -m benchmarks.smoothing [SHOT] [CHECKOUT]`: CPU time of the jobs that simulate, smooth and frame.

A gallery shot (A020_lorenz) is made by the production's own jobs, files and digests included, on one thread.
Given another checkout with its own `.venv`, both take turns, and the meshes and normals of both are compared
bit for bit. CPU milliseconds of a frame: medians of ROUNDS. Writes `benchmarks/out/smoothing.json`.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np

from benchmarks.report import Row, keep, show
from benchmarks.sitting import Sitting
from flowsculpt.pipeline.cli.app import keep_freed_memory
from flowsculpt.render.mitsuba.engine import choose

HERE = Path(__file__).resolve().parents[1]
ROUNDS = 3
STAGES = ("simulate", "smooth_normals", "frame_camera")


def main(shot: str = "A020_lorenz", *others: str) -> None:
    """Print a row for each checkout: this one first."""
    trees = [HERE, *map(Path, others)]
    rounds = [[_measured(tree, shot) for tree in trees] for _ in range(ROUNDS)]
    rows: list[Row] = []
    for number, tree in enumerate(trees):
        found = [row[number] for row in rounds]
        same = {one["digest"] for one in found} == {rounds[0][0]["digest"]}
        times = {stage: float(np.median([one[stage] for one in found])) for stage in STAGES}
        files = {"normals, MB": found[0]["MB"], "the same bits": "yes" if same else "NO"}
        rows.append({"checkout": tree.name, **times, **files})
    keep("smoothing", rows)
    show(f"{shot}: CPU ms a frame", rows)


def _measured(tree: Path, shot: str) -> dict[str, Any]:
    python, file = tree / ".venv" / "bin" / "python", HERE / "shots" / f"{shot}.yaml"
    command = [str(python), "-P", __file__, "child", str(file)]
    env = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=tree, env=env)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def child(shot: Path) -> None:
    """Do the jobs in this process; print what each took, and a digest of all arrays."""
    keep_freed_memory()  # as every command does, and so its jobs
    numba.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        made = Sitting.of(root, shot.read_text(encoding="utf-8"), "draft", choose(threads=1), cores=1)
        found: dict[str, Any] = {}
        for stage in STAGES:
            job, before = made.merged(stage), os.times()
            made.do(job)
            now = os.times()
            found[stage] = 1e3 * (now.user + now.system - before.user - before.system) / len(job.frames)
        digest, size = hashlib.sha256(), 0
        for path in sorted((root / "renders").rglob("*.npz")):
            size += path.stat().st_size if path.parent.name == "normals" else 0
            with np.load(path) as arrays:
                for name in sorted(arrays.files):
                    digest.update(arrays[name].tobytes())
        print(json.dumps({**found, "digest": digest.hexdigest(), "MB": size / 1e6}))


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        child(Path(sys.argv[2]))
    else:
        main(*sys.argv[1:])
