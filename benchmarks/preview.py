"""`python -m benchmarks.preview`: the speed of previews.

Raster: a geodesic sphere of 50 thousand vertices with bumps, on its stage, 480 × 270, by two threads.
Animatic: `flowsculpt preview` of 240 frames of a ball of about 25 thousand vertices between two vortices,
nothing simulated before, from the start of the process to its end. Edit: from the moment the file of that
shot is saved to the first picture on the live page that the edit changed; the edit is the last key of the
vortices. Seconds by the clock, and CPU seconds of all cores, which other work does not lengthen.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere, vertex_normals
from flowsculpt.pipeline.plugins.preview.live_session import LiveFeed, LiveSession, Message
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.render.raster import Shape, StageSetup, preview
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement

SHOT = """\
title: A ball between two vortices
frames: 1-240
subject: {solid: icosphere, radius: 1}
resample: {max_edge_length: 0.04}
flows:
  - sum:
      - vortex: {centre: [0.9, 0.3, 0], radius: 0.8, strength: {keys: {3: 0, 60: 1.2, 160: 1.2, 236: 0}}}
      - vortex: {centre: [-0.9, 0.3, 0], radius: 0.8, strength: {keys: {3: 0, 60: -1.2, 160: -1.2, 236: 0}}}
"""
EDIT = ("160: 1.2, 236: 0", "160: 1.2, 236: 0.4")
FIRST_CHANGED = 161
PICTURES = 120


def main() -> list[Target]:
    """Measure all three; return the targets."""
    per_second, each = raster()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "shots").mkdir()
        (root / "shots" / "ball.yaml").write_text(SHOT)
        wall, cores = animatic(root)
        seen, vertices = edited(root)
    rows: list[Row] = [
        {"what": "raster, pictures a second", "measured": per_second, "of a core, ms": each},
        {"what": "animatic of 240 frames, s", "measured": wall, "of a core, ms": 1e3 * cores / 240},
        {"what": "from the edit to the first picture, s", "measured": seen, "vertices": vertices},
    ]
    keep("preview", rows)
    show("Previews", rows)
    return [
        Target("raster, 50k vertices", "pictures a second", per_second, least=150.0),
        Target("animatic, 240 frames", "seconds", wall, most=5.0),
        Target("edit to picture", "seconds", seen, most=2.0),
    ]


def raster() -> tuple[float, float]:
    """Return the pictures a second of two threads, and the milliseconds of a core for one."""
    ball = icosphere(71)
    x, y, z = ball.vertices.T
    points = ball.vertices * (1.0 + 0.25 * np.sin(5 * x + 3 * y) * np.cos(4 * z))[:, None]
    normals = vertex_normals(TriangleMesh(points, ball.faces)).astype(np.float32)
    shape = Shape(points.astype(np.float32), normals, ball.faces, LOOKS["glaze"], closed=True)
    around = StageSetup(
        LIGHTS["studio"], STAGES["cyclorama"], StagePlacement((0.0, float(points[:, 1].min()), 0.0), 1.2)
    )
    camera = Camera((0.0, 1.0, 8.5), (0.0, -0.1, 0.0))

    def drawn(_: int) -> None:
        preview(shape, around, camera, (480, 270), "rec709")

    drawn(0)
    with ThreadPoolExecutor(2) as pool:
        started, spent = time.perf_counter(), time.process_time()
        list(pool.map(drawn, range(PICTURES)))
        wall, cores = time.perf_counter() - started, time.process_time() - spent
    return PICTURES / wall, 1e3 * cores / PICTURES


def animatic(root: Path) -> tuple[float, float]:
    """Return the seconds by the clock, and of all cores together."""
    before, started = _spent(), time.perf_counter()
    command = [sys.executable, "-m", "flowsculpt", "--no-progress", "preview", "ball"]
    subprocess.run(command, cwd=root, check=True, capture_output=True, env={**os.environ})
    return time.perf_counter() - started, _spent() - before


def edited(root: Path) -> tuple[float, int]:
    """Return the seconds from an edit to the first picture that it changed, and its vertices."""
    shot, feed = root / "shots" / "ball.yaml", LiveFeed()
    heard = feed.subscribe()
    with SurfaceStream(Project(root, 2).store) as stream:
        requests: list[Any] = []

        def sketch() -> Sketch:
            requests.append(Project(root, 2).request(shot, "draft", None, variant="none"))
            return Sketch(requests[-1])

        session = LiveSession(sketch, feed, stream, lambda ready: None, {shot})
        threading.Thread(target=session.follow, daemon=True).start()
        _hear(heard, "words", "Save the shot file to see what changes.")
        started = time.perf_counter()
        shot.write_text(SHOT.replace(*EDIT))
        _hear(heard, "frame", FIRST_CHANGED)
        seen = time.perf_counter() - started
        _hear(heard, "words", "Save the shot file to see what changes.")
        return seen, len(stream.arrays(requests[-1], FIRST_CHANGED)["vertices"])


def _hear(heard: SimpleQueue[Message], name: str, value: str | int) -> None:
    """Wait for a message."""
    while heard.get(timeout=600.0).get(name) != value:
        pass


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    for target in main():
        print(target.row)
