"""`python -m benchmarks.long_run [FRAMES]`: memory of a process that renders many frames.

A box is twisted and resampled for 500 frames, 96 × 54 pixels, denoised over time with one frame to either
side. One process renders all frames, another finishes them; the production starts a new process every few
dozen frames, which would hide leaks. Resident memory is recorded after every frame. Target: within 5% of its
value at frame 50 at the end, and at most so much above it before. Writes `benchmarks/out/long_run.json`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from benchmarks.report import Row, Target, keep, show
from benchmarks.sitting import PLAN, Sitting
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import PLANS
from flowsculpt.render.mitsuba.engine import choose

SHOT = """\
title: A box, wrung to and fro
frames: 1-{frames}
rate: 24
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: 0.12, placement: chord}}
flows:
  - twist: {{axis: y, amount: {{formula: 60*sin(2*pi*t)}}}}
look: glaze
camera: {{azimuth: -24, elevation: 14}}
quality: {{daily: {{samples: 4, auxiliary_samples: 4, depth: 4, temporal_denoise: 1}}}}
"""

QUALITY = "daily.scale10"
SETTLED, MOST = 50, 0.05
TASKS = ("render", "finish")


@dataclass
class Memory(EventLog):
    """An event log that records the resident memory of the process at each frame."""

    sizes: list[float] = field(default_factory=list)

    def write(self, event: str, **facts: Any) -> None:
        super().write(event, **facts)
        if event == "frame":
            self.sizes.append(psutil.Process().memory_info().rss / 2**20)


def main(frames: int = 500) -> list[Target]:
    """Make all frames; return the targets, the growth of memory after it has settled."""
    engine = choose(threads=1)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        shot = Sitting.of(root, SHOT.format(frames=frames), QUALITY, engine, cores=1)
        shot.do_all(["simulate", "smooth_normals", "frame_camera"])
        sizes = {task: _watched(root, task) for task in TASKS}
    rows = [_row(task, sizes[task]) for task in TASKS]
    show(f"Resident memory over {frames} frames, MiB", rows)
    keep("long_run", rows)
    return [
        Target(f"{frames} frames, {row['task']}", what, float(row[what]), most=MOST)
        for row in rows
        for what in ("at the end, share more", "at most, share more")
    ]


def _watched(root: Path, task: str) -> list[float]:
    command = [sys.executable, "-m", "benchmarks.long_run", "child", str(root), task]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return list(json.loads(done.stdout.splitlines()[-1]))


def child(root: Path, task: str) -> None:
    """Make all frames of a task in this process, and print its resident memory after each."""
    shot = Sitting(root, Plan.thaw(root / PLANS / f"{PLAN}.json"))
    log = Memory(root / f"{task}.jsonl", task)
    shot.do(shot.merged(task), log)
    print(json.dumps(log.sizes))


def _row(task: str, sizes: list[float]) -> Row:
    settled = sizes[min(SETTLED, len(sizes) // 2) - 1]
    after = sizes[min(SETTLED, len(sizes) // 2) - 1 :]
    marks = {f"frame {n}": sizes[n - 1] for n in (1, 10, 50, 100, 200, 300, 400, 500) if n <= len(sizes)}
    return {
        "task": task,
        **marks,
        "at the end, share more": sizes[-1] / settled - 1.0,
        "at most, share more": max(after) / settled - 1.0,
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        child(Path(sys.argv[2]), sys.argv[3])
    else:
        show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
