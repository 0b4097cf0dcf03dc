"""`python -m benchmarks.adaptive [WIDTH] [REFERENCE]`: adaptive against uniform sampling, at equal error.

One frame of gallery shots of clay, glaze, glass and marble, WIDTH pixels wide (480), at final: with its noise
threshold, and with 64 samples everywhere. Of pictures wider than 960 pixels it is the lower right quarter, of
which the subject covers as much as of the whole, within a third. Seconds are CPU seconds of tracing light and
features, building the scene and denoising. The error is the root mean square of denoised display values, in
steps of 255, against two independent pictures of REFERENCE samples (128): the mean product of both
differences has no noise of the references in it. Target: at most half of the seconds, and 1.05 times the
error, on the first two frames; no more seconds on others. Writes `benchmarks/out/adaptive.json`, and of each
frame a PNG: uniform, adaptive, and its samples (white is the most).
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.errors import put, shown
from benchmarks.measured_shots import copy_shots
from benchmarks.raw_files import as_read
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.render import ShownFrame
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.render_quality import QUALITIES
from flowsculpt.render.scene.scene import Scene

FRAMES = {"A010_cube": 40, "A020_lorenz": 50, "B050_glass": 201, "B030_marble": 141}
UNIFORM = 64
WIDEST = 960
"""Pixels up to which whole pictures are measured."""
HALVED = ("A010_cube", "A020_lorenz")
MOST_OF_HALVED, MOST_OF_OTHERS, MOST_ERROR = 0.5, 1.05, 1.05
"""Targets: seconds over those of uniform sampling, and error over its error."""

T = TypeVar("T")


def scene_of(root: Path, shot: str, frame: int) -> Scene:
    """Return the scene of a frame, after a small draft of it in `root`, which simulates and frames it."""
    words = ["--no-progress", "--root", str(root), "render", shot, "-f", str(frame), "--scale", "25%"]
    subprocess.run([sys.executable, "-m", "flowsculpt", *words], check=True, stdout=subprocess.DEVNULL)
    with chdir(root):
        plan = Plan.thaw(max((root / ".flowsculpt" / "plans").glob("*.json"), key=os.path.getmtime))
        job = next(job for job in plan.jobs if job.stage == "render")
        context = Context.of(root, plan, job.name)
        request = context.request
        sample, _, _ = ShownFrame(context, frame, request.pictures.framings(context.store) or {}).moments()
    picture = request.shot.picture
    lights = picture.lights.turned(request.angles[frame].lights)
    return Scene(sample.subject, picture.look, lights, picture.stage, sample.placement, sample.camera)


def measure(shot: str, scene: Scene, width: int, reference: int) -> Row:
    """Return seconds and errors of both, and the samples that adaptive sampling took."""
    engine = choose()
    height = width * 9 // 16
    quarter = (width // 2, height // 2, width, height) if width > WIDEST else None
    final = replace(QUALITIES["final"], width=width, height=height, crop=quarter)
    even = replace(final, samples=UNIFORM, noise_threshold=None)
    render_frame(scene, replace(final, width=64, height=36, crop=None), 1, engine)  # compiles
    exact = replace(even, samples=reference, auxiliary_samples=1, fireflies="keep")
    truths = [shown(render_frame(scene, exact, seed, engine)["beauty"]) for seed in (2, 3)]

    def error(light: AnyArray) -> float:
        product = np.prod([shown(light) - truth for truth in truths], axis=0)
        return 255.0 * math.sqrt(max(float(product.mean()), 0.0))

    uniform, even_seconds = _clocked(lambda: denoise(as_read(render_frame(scene, even, 1, engine))))
    frame, seconds = _clocked(lambda: render_frame(scene, final, 1, engine, aovs=("samples",)))
    adaptive, more = _clocked(lambda: denoise(as_read(frame)))
    map_of_samples = np.repeat(frame["samples"][..., None] / frame["samples"].max(), 3, axis=2)
    put(f"adaptive_{shot}", {"uniform": uniform, "adaptive": adaptive, "samples": map_of_samples})
    row: Row = {
        "frame": f"{shot} {FRAMES[shot]}",
        "samples": float(frame["samples"].mean()),
        "uniform, CPU s": even_seconds,
        "adaptive, CPU s": seconds + more,
        "uniform, error": error(uniform),
        "adaptive, error": error(adaptive),
    }
    row["seconds over uniform"] = float(row["adaptive, CPU s"]) / even_seconds
    row["error over uniform"] = float(row["adaptive, error"]) / float(row["uniform, error"])
    return row


def _clocked(work: Callable[[], T]) -> tuple[T, float]:
    """Return a result and the CPU seconds that it took."""
    begun = resource.getrusage(resource.RUSAGE_SELF)
    result = work()
    ended = resource.getrusage(resource.RUSAGE_SELF)
    return result, ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime


def main(width: int = 480, reference: int = 128) -> list[Target]:
    """Measure all frames; return the targets."""
    choose().start()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        copy_shots(root)
        for shot, frame in FRAMES.items():
            rows.append(measure(shot, scene_of(root, shot, frame), width, reference))
    show("Adaptive sampling", rows)
    keep("adaptive", rows)
    targets = []
    for shot, row in zip(FRAMES, rows, strict=True):
        most = MOST_OF_HALVED if shot in HALVED else MOST_OF_OTHERS
        for name, bound in (("seconds over uniform", most), ("error over uniform", MOST_ERROR)):
            targets.append(Target(f"adaptive, {shot}", name, float(row[name]), most=bound))
    return targets


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
