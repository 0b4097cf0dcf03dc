"""`python -m benchmarks.scenes [REPEATS]`: from arrays to a scene to render, against Mitsuba alone.

Geodesic spheres of 50 thousand and of a million vertices in the studio. Ours is `build_scene`: it checks the
arrays, makes stage, emitters and materials, and passes all to Mitsuba. Mitsuba alone gets the same arrays,
stage and emitters as shapes made before the clock starts, so that its time is that of the bounding volumes.
Both run in turn, the least of several counts. Writes `benchmarks/out/scenes.json`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.mesh.solids import icosphere
from flowsculpt.render.mitsuba.emitters import emitters
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.mitsuba.shapes import mesh, stage_shapes
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

FREQUENCIES = {"50k": 71, "1M": 316}
"""Frequencies of the spheres: 10 n² + 2 vertices."""

CAMERA = Camera((2.2, 2.6, 6.0), (0.0, 0.9, 0.0))
SIZE = (1280, 720)
MOST_MS, MOST_TIMES = 40.0, 1.1
"""Targets: milliseconds at 50k, and the time over Mitsuba's own at 1M."""


def ball(frequency: int) -> Surface:
    made = icosphere(frequency)
    points = (made.vertices + np.array([0.0, 1.0, 0.0])).astype(np.float32)
    return Surface(points, made.vertices.astype(np.float32), made.faces)


def measure(size: str, repeats: int) -> Row:
    """Return the milliseconds of both."""
    surface = ball(FREQUENCIES[size])

    scene = Scene(surface, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
    quality = Quality(*SIZE, samples=16, depth=6)

    def ours() -> None:
        build_scene(scene, quality)

    seconds: dict[str, list[float]] = {"ours": [], "Mitsuba's": []}
    ours()  # compiles
    for _ in range(repeats):
        seconds["ours"].append(_clocked(ours))
        shapes = _shapes(surface)
        _settled()
        seconds["Mitsuba's"].append(_clocked(partial(_loaded, shapes)))
    best = {who: 1000.0 * min(times) for who, times in seconds.items()}
    return {"vertices": len(surface.vertices), **best, "ratio": best["ours"] / best["Mitsuba's"]}


def _shapes(surface: Surface) -> dict[str, Any]:
    import mitsuba as mi

    subject = mesh("subject", surface, {"type": "diffuse"}, np.array([0.0, 1.0]))
    shining = emitters(LIGHTS["studio"], StagePlacement().matrix())
    made = {name: mi.load_dict(each, parallel=False, optimize=False) for name, each in shining.items()}
    return {"subject": subject, **stage_shapes(STAGES["cyclorama"], StagePlacement(), CAMERA, SIZE), **made}


def _loaded(shapes: dict[str, Any]) -> None:
    import mitsuba as mi

    mi.load_dict({"type": "scene", **shapes}, parallel=False, optimize=False)


def _settled() -> None:
    """Wait until all queued work of Dr.Jit is done."""
    import drjit as dr

    dr.eval()
    dr.sync_thread()


def _clocked(work: Callable[[], None]) -> float:
    begun = time.perf_counter()
    work()
    _settled()
    return time.perf_counter() - begun


def main(repeats: int = 7) -> list[Target]:
    """Measure both sizes; return the targets."""
    choose().start()
    rows = {size: measure(size, repeats) for size in FREQUENCIES}
    show("From arrays to a scene, milliseconds", list(rows.values()))
    keep("scenes", list(rows.values()))
    return [
        Target("scene:50k", "ms", float(rows["50k"]["ours"]), most=MOST_MS),
        Target("scene:1M", "times Mitsuba's own", float(rows["1M"]["ratio"]), most=MOST_TIMES),
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
