"""`python -m benchmarks.denoising [REFERENCE] [SHOT …]`: errors and CPU seconds of the denoiser's efforts.

Frames of gallery shots at draft, daily and final, scaled to 480 × 270 pixels: as many samples as each quality
takes, and paths as long as those of final. Raw pictures are rendered by the command and read from their files
as `finish` reads them, then denoised with each effort, alone. `first surface` is the highest effort guided by
the features of the first surface, also in mirrors and glass.

The error is the root mean square of display values, in steps of 255, against two independent pictures of
REFERENCE samples (128): the mean product of both differences has no noise of the references in it. Target:
features behind mirrors make no error larger by 2%. Writes `benchmarks/out/denoising.json` and PNGs.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.errors import put, shown
from benchmarks.measured_shots import copy_shots
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.post.image import read_exr
from flowsculpt.render.scene.aovs import DENOISER, RenderedFrame

FRAMES = {
    "A010_cube": 40,
    "A020_lorenz": 34,
    "B010_honey": 30,
    "B030_marble": 40,
    "B050_glass": 40,
    "B060_smoke": 40,
    "B070_sunlit": 40,
    "B100_torus": 40,
}
"""Shots of clay, glaze, honey, marble, glass, smoke, clay in the sun, and chrome."""

SCALES = {"draft": "100%", "daily": "50%", "final": "25%"}
EFFORTS = ("fast", "balanced", "high")
MOST = 1.02


def measure(root: Path, shot: str, reference: int) -> list[Row]:
    """Return the errors and CPU seconds of a shot's frame at each quality."""
    exact = f"quality.draft={{samples: {reference}, auxiliary_samples: 1, depth: 10, fireflies: keep}}"
    truths = [
        shown(raw_picture(root, name, FRAMES[shot], "draft", exact)["beauty"]) for name in copies(root, shot)
    ]
    rows: list[Row] = []
    for quality in SCALES:
        raw = raw_picture(root, shot, FRAMES[shot], quality, f"quality.{quality}.depth=10")
        denoise(raw)  # allocates
        row: Row = {"shot": shot, "quality": quality, "samples": raw.facts["samples"]}
        pictures = {}
        for effort in EFFORTS:
            begun = time.process_time()
            pictures[effort] = denoise(raw, effort)
            row |= {effort: error(pictures[effort], truths), f"{effort}, CPU s": time.process_time() - begun}
        rows.append({**row, "first surface": error(denoise(_first_surface(raw)), truths)})
        put(f"denoising_{shot}_{quality}", pictures)
    return rows


def raw_picture(root: Path, shot: str, frame: int, quality: str, setting: str) -> RenderedFrame:
    """Render a frame in a project at `root`; return its raw picture as it is read from its file."""
    words = ["render", shot, "-f", str(frame), "-q", quality, "--scale", SCALES[quality], "--set", setting]
    command = [sys.executable, "-m", "flowsculpt", "--no-progress", "-j", "1", *words]
    subprocess.run(command, cwd=root, check=True, stdout=subprocess.DEVNULL)
    (path,) = (root / "renders" / shot).glob(f"{quality}*/raw/{shot}.{frame:04d}.exr")
    return read_exr(path)[0]


def copies(root: Path, shot: str) -> list[str]:
    """Return the names of two copies of a shot, whose pictures have other noise."""
    names = [f"{shot}_{i}" for i in (1, 2)]
    for name in names:
        (root / "shots" / f"{name}.yaml").write_text((root / "shots" / f"{shot}.yaml").read_text())
    return names


def error(light: AnyArray, truths: list[AnyArray]) -> float:
    """Return the error of linear light (H, W, 3) against two independent truths, in steps of 255."""
    product = np.prod([shown(light) - truth for truth in truths], axis=0)
    return 255.0 * math.sqrt(max(float(product.mean()), 0.0))


def _first_surface(frame: RenderedFrame) -> RenderedFrame:
    """Return the frame without the features that mirrors and glass show."""
    arrays = {name: array for name, array in frame.arrays.items() if name not in DENOISER}
    return RenderedFrame(arrays, frame.facts)


def main(reference: int = 128, *shots: str) -> list[Target]:
    """Measure all; return the target."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        copy_shots(Path(folder))
        for shot in shots or FRAMES:
            rows += measure(Path(folder), shot, reference)
            show(f"Errors of {shot}, steps of 255, and CPU seconds", rows[-len(SCALES) :])
    keep("denoising", rows)
    worst = max(_ratio(row) for row in rows)
    return [Target("denoising", "worst error over that by features of the first surface", worst, most=MOST)]


def _ratio(row: Mapping[str, float | str]) -> float:
    return float(row["high"]) / float(row["first surface"])


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[1:] if each.isdigit()]
    names = [each for each in sys.argv[1:] if not each.isdigit()]
    show("Targets", [target.row for target in main((numbers or [128])[0], *names)])
