"""`python -m benchmarks.denoising [WIDTH] [REFERENCE]`: what the denoiser gains by features behind mirrors.

A torus of chrome, glass, clay and glaze in the studio, the gallery and daylight, WIDTH × 9/16 WIDTH pixels
(320), with 16 and 64 samples. Each picture is denoised with the features of the first surface, and with those
that `denoiser_features` chooses. The error is the root mean square difference from REFERENCE samples (1024),
in steps of an 8-bit display. The reference is denoised with the features of the first surface, so that its
noise counts for neither. Writes `benchmarks/out/denoising.json` and PNGs.
"""

from __future__ import annotations

import itertools
import sys

import numpy as np

from benchmarks.errors import put, shown
from benchmarks.flicker import CAMERA, subject
from benchmarks.report import Row, Target, keep, show
from pipeline.arrays import AnyArray
from render.frame.render_frame import render_frame
from render.mitsuba.engine import Engine, choose
from render.post.denoise import denoise
from render.scene.aovs import DENOISER, RenderedFrame
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.quality import Quality
from render.scene.scene import Scene
from render.scene.stage import STAGES, StagePlacement

SHOWN, RIGS, SAMPLES = ("chrome", "glass", "clay", "glaze"), ("studio", "gallery", "daylight"), (16, 64)
MOST = 1.02
"""Target: the error over that with the features of the first surface."""


def measure(look: str, rig: str, size: tuple[int, int], reference: int, engine: Engine) -> list[Row]:
    """Return the errors of one look in one light rig."""
    parts = (LOOKS[look], LIGHTS[rig], STAGES["cyclorama"], StagePlacement(), CAMERA)

    def rendered(samples: int, seed: int) -> RenderedFrame:
        quality = Quality(*size, samples, depth=10, auxiliary_samples=min(samples, 64))
        return render_frame(Scene(subject(0.3), *parts), quality, seed, engine)

    truth = _first_surface(rendered(reference, 99))
    rows: list[Row] = []
    for samples in SAMPLES:
        frame = rendered(samples, 1)
        pictures = {"first surface": _first_surface(frame), "chosen": denoise(frame)}
        errors = {name: _error(picture, truth) for name, picture in pictures.items()}
        ratio = errors["chosen"] / errors["first surface"]
        rows.append({"look": look, "lights": rig, "samples": samples, **errors, "ratio": ratio})
        put(f"denoising_{look}_{rig}_{samples}", {"raw": frame["beauty"], **pictures, "reference": truth})
    return rows


def _first_surface(frame: RenderedFrame) -> AnyArray:
    """Return the beauty, denoised with the features of the first surface."""
    arrays = {name: array for name, array in frame.arrays.items() if name not in DENOISER}
    return denoise(RenderedFrame(arrays, frame.facts))


def _error(picture: AnyArray, truth: AnyArray) -> float:
    return 255.0 * float(np.sqrt(((shown(picture) - shown(truth)) ** 2).mean()))


def main(width: int = 320, reference: int = 1024) -> list[Target]:
    """Measure all; return the targets."""
    engine, size = choose(), (width, width * 9 // 16)
    rows: list[Row] = []
    for look, rig in itertools.product(SHOWN, RIGS):
        rows += measure(look, rig, size, reference, engine)
        show(f"Errors of {look} in {rig}, steps of 255", rows[-len(SAMPLES) :])
    keep("denoising", rows)
    worst = max(float(row["ratio"]) for row in rows)
    return [Target("denoising", "worst error over that by features of the first surface", worst, most=MOST)]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
