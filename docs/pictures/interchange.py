"""The picture of the page on interchange: a frame as we render it, and as Cycles renders the exported stage.

After `make blender`: `python docs/pictures/interchange.py --root DIR` renders both below DIR.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import Image

from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.image import read_exr

OUT = Path(__file__).parent
REPOSITORY = OUT.parents[1]
NAME, FRAME = "T_thrown", 6
SIZE = (960, 540)
SHOT = """\
title: A box, thrown
frames: 1-12
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.1}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 12: 90}}}
  - rotation: {axis: z, speed: 300}
camera: {azimuth: -30, elevation: 14, follow: 0}
shutter: {angle: 180}
look: clay
lights: {rig: studio, exposure: -0.7}
quality: {daily: {temporal_denoise: 0}}
"""


def main() -> None:
    """Render both, tell how far they are apart, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, required=True)
    root = parser.parse_args().root.resolve()
    (root / "shots").mkdir(parents=True, exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    for words in (("export", "usd", NAME), ("render", NAME, "-q", "daily", "-f", str(FRAME))):
        subprocess.run([sys.executable, "-m", "flowsculpt", *words], cwd=root, check=True)
    home, cycles = root / "renders" / NAME, root / "cycles.exr"
    script = REPOSITORY / "tests" / "dailies" / "interchange" / "blender_render.py"
    words = [str(home / "usd" / f"{NAME}.usda"), str(FRAME), *map(str, SIZE), "32", "0.5", str(cycles)]
    blender = os.environ.get("BLENDER_MODULE", str(Path(sys.prefix) / "cycles"))
    environment = {**os.environ, "PYTHONPATH": blender}
    subprocess.run([sys.executable, "-P", str(script), *words], env=environment, check=False)
    ours = read_exr(home / "daily" / "frames" / f"{NAME}.{FRAME:04d}.exr")[0]["beauty"]
    theirs = np.ascontiguousarray(oiio.ImageBuf(str(cycles)).get_pixels(oiio.FLOAT)[..., :3])
    apart = np.abs(ours - theirs).mean(axis=2) / (ours.mean(axis=2) + 0.05)
    print(
        f"mean light {theirs.mean() / ours.mean() - 1:+.2%}, half of the pixels within {np.median(apart):.2%}"
    )
    shown = [quantise(to_display(picture, -0.7), bits=8) for picture in (ours, theirs)]
    with Image.fromarray(np.hstack(shown)) as sheet:
        sheet.resize((1280, 360)).save(OUT / "interchange.webp", quality=86, method=6)


if __name__ == "__main__":
    main()
