"""The stills of docs/gallery.md, one a shot, at draft: `make pictures`, or this file with shots' names.

`--root` says where to render.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from PIL import Image

from render.colour import quantise, to_display
from render.image import read_exr

HERE = Path(__file__).parent / "gallery"
STILLS = {
    "A010_cube": 44,
    "A020_lorenz": 56,
    "A030_taffy": 54,
    "B010_honey": 121,
    "B020_dough": 161,
    "B030_marble": 141,
    "B040_coffee": 161,
    "B050_glass": 201,
    "B060_smoke": 150,
    "B070_ring": 120,
    "B080_motes": 161,
    "B090_enright": 84,
    "B100_torus": 118,
    "B110_abc": 130,
}
"""The frame that shows most of each shot."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shots", nargs="*", metavar="SHOT", default=list(STILLS))
    parser.add_argument("--root", type=Path, default=Path())
    asked = parser.parse_args()
    unknown = sorted(set(asked.shots) - set(STILLS))
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such still; there are {', '.join(STILLS)}")
    HERE.mkdir(exist_ok=True)
    for shot in asked.shots:
        _draw(shot, STILLS[shot], asked.root)


def _draw(shot: str, frame: int, root: Path) -> None:
    words = ["--no-progress", "--root", str(root), "render", shot, "-q", "draft", "-f", str(frame)]
    subprocess.run([sys.executable, "-m", "pipeline.cli", *words], check=True)
    layers, _ = read_exr(root / "renders" / shot / "draft" / "frames" / f"{shot}.{frame:04d}.exr")
    picture = Image.fromarray(quantise(to_display(layers["beauty"], display="srgb")))
    picture.save(HERE / f"{shot}.webp", quality=86, method=6)


if __name__ == "__main__":
    main()
