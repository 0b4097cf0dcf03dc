"""`python -m benchmarks.variants [VARIANT] [SHOT@FRAME …]`: frames by a variant of Mitsuba and by LLVM.

By default `cuda_ad_rgb`, on a machine with a GPU, and one frame each of eleven shots. Meshes are simulated
before the clock starts; each frame is then a command of its own, as a single frame of a farm is. Differences
are of the raw picture, before the denoiser: the mean of the absolute difference over the mean of the layer.
Variants draw the same random numbers: frames differ by rounding, and where rounding sends a path elsewhere.
Writes `benchmarks/out/variants.json`.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.first_film import CHECKOUT, run
from benchmarks.measured_shots import shot_file
from benchmarks.report import Row, keep, show
from flowsculpt.render.post.image import read_exr

FRAMES = (
    "A010_cube@44",
    "A020_lorenz@30",
    "A030_taffy@54",
    "B010_honey@60",
    "B030_marble@60",
    "B050_glass@80",
    "B060_smoke@40",
    "B080_motes@40",
    "B100_torus@60",
    "B120_pillars@40",
    "B150_pair@60",
)
OTHER = "llvm_ad_rgb"


def main(words: list[str]) -> list[Row]:
    variant = words.pop(0) if words and "@" not in words[0] else "cuda_ad_rgb"
    rows = [measure(variant, *asked.split("@")) for asked in words or FRAMES]
    keep("variants", rows)
    return rows


def measure(variant: str, shot: str, frame: str) -> Row:
    """Return the time of a frame's draft by both variants, and how far its layers are apart.

    Raises CalledProcessError where one fails, RuntimeError where the machine cannot run the variant.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    path = shot_file(shot)
    row: Row = {"shot": shot, "frame": frame}
    layers = []
    with tempfile.TemporaryDirectory() as root:
        ours = [CHECKOUT / ".venv/bin/flowsculpt", "--no-progress", "--root", root]
        run([*ours, "simulate", path, "-f", f"1-{frame}"], CHECKOUT, environment)
        for name in (variant, OTHER):
            words = ["render", path, "-f", frame, "--no-preview", "--variant", name]
            row[f"{name}, s"] = run([*ours, *words], CHECKOUT, environment).clock
            rendered, header = read_exr(next(Path(root, f"renders/{shot}/draft/raw").glob("*.exr")))
            if header["variant"] != name:
                raise RuntimeError(f"{name} cannot render {shot} here: {header['variant']} did")
            layers.append(rendered.arrays)
    apart = {
        layer: float(np.abs(one - layers[1][layer]).mean() / max(np.abs(layers[1][layer]).mean(), 1e-9))
        for layer, one in layers[0].items()
    }
    row["beauty"] = apart.pop("beauty")
    worst = max(apart, key=apart.__getitem__)
    return {**row, "worst of the others": apart[worst], "it is": worst}


if __name__ == "__main__":
    show("Two variants", main(sys.argv[1:]))
