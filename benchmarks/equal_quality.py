"""`python -m benchmarks.equal_quality [WIDTH] [REFERENCE]`: time to equal error, against Mitsuba alone.

A glazed and a clay torus in the studio, WIDTH pixels wide (320). Ours: `render_frame` with 16 samples and the
auxiliary features, and the denoiser; the median of five, with building the scene. Raw: the same scene by
Mitsuba alone, with its default sampler (`independent`), until the error is the same: PSNR of display values,
and FLIP. The time is interpolated between powers of two of samples, where the logarithm of the error is
nearly linear. The reference has REFERENCE samples (4096) of our sampler. Target: 8 times less time. Writes
`benchmarks/out/equal_quality.json` and PNGs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.errors import flip, psnr, put
from benchmarks.flicker import CAMERA, subject
from benchmarks.raw_files import as_read
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.mitsuba.mitsuba_scene import SceneRenderer, build_scene
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement

SHOWN = ("glaze", "clay")
DEPTH, PASS, REPEATS = 6, 16, 5
MOST_SAMPLES = 1024
LEAST = 8.0
"""Target: the time of Mitsuba over ours."""


@dataclass(frozen=True)
class Best:
    """Samples, seconds and pictures of a growing number of samples, at powers of two."""

    samples: list[int]
    seconds: list[float]
    pictures: list[AnyArray]

    def until(self, error_of: Callable[[AnyArray], float], wanted: float) -> float:
        """Return the seconds until an error that falls is `wanted`.

        Linear in logarithms between two pictures, and extrapolated by the overall slope beyond the last one.
        """
        times, errors = np.log(self.seconds), np.log([error_of(each) for each in self.pictures])
        if errors[-1] <= np.log(wanted):
            return float(np.exp(np.interp(-np.log(wanted), -errors, times)))
        slope, level = np.polyfit(errors, times, 1)
        return float(np.exp(slope * np.log(wanted) + level))


def measure(look: str, size: tuple[int, int], reference: int, engine: Engine) -> Row:
    """Return the seconds of both to equal errors."""
    surface = subject(0.3)
    quality = Quality(*size, samples=16, depth=DEPTH, auxiliary_samples=16)

    described = Scene(surface, LOOKS[look], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)

    def scene() -> SceneRenderer:
        return build_scene(described, quality).beauty

    def ours() -> AnyArray:
        return denoise(as_read(render_frame(described, quality, 1, engine)))

    picture = ours()  # compiles
    took = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        ours()
        took.append(time.perf_counter() - begun)
    raw = rendered_on(scene, size)
    truth = _mean(scene(), reference)
    worth = psnr(picture, truth)
    put(f"equal_{look}", {"16 denoised": picture, f"{raw.samples[-1]} raw": raw.pictures[-1], "truth": truth})
    mean = float(np.median(took))
    row: Row = {
        "look": look,
        "ours, s": mean,
        "PSNR, dB": worth,
        "raw 16, dB": psnr(raw.pictures[raw.samples.index(16)], truth),
        "raw until that, s": raw.until(lambda p: 10.0 ** (-psnr(p, truth) / 20.0), 10.0 ** (-worth / 20.0)),
    }
    row["times"] = float(row["raw until that, s"]) / mean
    seen = flip(picture, truth)
    if seen is not None:
        row["FLIP"] = seen
        row["raw 16, FLIP"] = flip(raw.pictures[raw.samples.index(16)], truth) or 0.0
        row["raw until that FLIP, s"] = raw.until(lambda p: flip(p, truth) or 0.0, seen)
        row["times, FLIP"] = float(row["raw until that FLIP, s"]) / mean
    return row


def rendered_on(scene: Callable[[], SceneRenderer], size: tuple[int, int]) -> Best:
    """Accumulate passes of Mitsuba's default sampler; keep their mean at each power of two."""
    import mitsuba as mi

    begun = time.perf_counter()
    rendering = scene()
    lens = mi.load_dict({**sensor(CAMERA, size), "sampler": {"type": "independent"}})
    best, total = Best([], [], []), np.zeros((size[1], size[0], 3))
    spent = time.perf_counter() - begun
    for taken in range(1, MOST_SAMPLES // PASS + 1):
        begun = time.perf_counter()
        total = total + one_pass(rendering, 1000 + taken, sensor=lens)
        spent += time.perf_counter() - begun
        if taken & (taken - 1) == 0:
            best.samples.append(taken * PASS)
            best.seconds.append(spent)
            best.pictures.append(np.asarray(total / taken))
    return best


def _mean(rendering: SceneRenderer, samples: int) -> AnyArray:
    count = max(1, samples // PASS)
    return np.asarray(sum(one_pass(rendering, 50_000 + i) for i in range(count)) / count)


def one_pass(rendering: SceneRenderer, seed: int, **by: Any) -> AnyArray:
    import drjit as dr
    import mitsuba as mi

    found = mi.render(rendering.scene, integrator=rendering.integrator, spp=PASS, seed=seed, **by)
    picture = np.array(found, dtype=np.float64)[..., :3]
    dr.flush_malloc_cache()
    return picture


def main(width: int = 320, reference: int = 4096) -> list[Target]:
    """Measure both looks; return the targets."""
    engine = choose()
    engine.start()
    rows = [measure(look, (width, width * 9 // 16), reference, engine) for look in SHOWN]
    show("Time to the same error", rows)
    keep("equal_quality", rows)
    return [
        Target(f"16 denoised, {row['look']}", f"{what} less", float(row[what]), least=LEAST)
        for row in rows
        for what in ("times", "times, FLIP")
        if what in row
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
