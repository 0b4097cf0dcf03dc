"""The stills of docs/gallery.md, one a shot: `make pictures`, or this file with shots' names.

They are rendered at daily quality, as large as they are shown. `--root` says where to render, `-q` at what
other quality. Each is measured as it is displayed: it should have a highlight, the 99th percentile of
luminance at 200 of 255 or above, and at most half a percent of its pixels clipped in any channel.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from flowsculpt.pipeline.production.picture_sequences import white_level

HERE = Path(__file__).parent / "gallery"
STILLS = {
    "A010_cube": 64,
    "A020_lorenz": 64,
    "A030_taffy": 80,
    "B010_honey": 121,
    "B020_inks": 92,
    "B030_marble": 141,
    "B040_monument": 100,
    "B050_amber": 100,
    "B060_bloom": 84,
    "B070_ring": 120,
    "B080_motes": 161,
    "B090_leaves": 72,
    "B100_torus": 118,
    "B110_ribbon": 96,
    "B120_pillars": 120,
    "B130_pulse": 131,
    "B140_corolla": 66,
    "B150_pair": 170,
    "B160_loops": 50,
    "B170_endless": 44,
    "B180_pool": 84,
    "B190_moon": 84,
    "B200_walker": 62,
    "B210_jets": 1,
    "B220_landing": 31,
    "B230_duet": 49,
}
"""The frame that shows most of each shot."""

WIDTH = 960
LEAST_WHITE, MOST_CLIPPED = 200, 0.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shots", nargs="*", metavar="SHOT", default=list(STILLS))
    parser.add_argument("--root", type=Path, default=Path())
    parser.add_argument("-q", "--quality", default="daily")
    asked = parser.parse_args()
    unknown = sorted(set(asked.shots) - set(STILLS))
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such still; there are {', '.join(STILLS)}")
    HERE.mkdir(exist_ok=True)
    for shot in asked.shots:
        if missing := _missing_plugins(shot):
            print(f"{shot} is left out: it needs the plug-in {missing[0]}, which is not installed")
            continue
        _draw(shot, STILLS[shot], asked.root, asked.quality)


def _missing_plugins(shot: str) -> list[str]:
    """Return those of the plug-ins that are named in a shot's first line which are not installed."""
    named = re.match(r"# Needs the plug-ins? (.*)\.\n", Path("shots", f"{shot}.yaml").read_text())
    names = re.split(", | and ", named[1]) if named else []
    return [name for name in names if find_spec(f"flowsculpt.pipeline.plugins.{name}") is None]


def _draw(shot: str, frame: int, root: Path, quality: str) -> None:
    words = ["--no-progress", "--root", str(root), "stills", shot, "-q", quality, "-f", str(frame)]
    subprocess.run([sys.executable, "-m", "flowsculpt", *words], check=True)
    with Image.open(root / "renders" / shot / quality / "png" / f"{shot}.{frame:04d}.png") as still:
        shown = still.convert("RGB")
        print(_levels(shot, np.asarray(shown)))
        shown.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
        shown.save(HERE / f"{shot}.webp", quality=88, method=6)


def _levels(shot: str, pixels: NDArray[np.uint8]) -> str:
    """Return a line: the 99th percentile of luminance, and the percentage of clipped pixels by channel."""
    brightest, clipped = white_level(pixels), 100 * (pixels == 255).mean(axis=(0, 1))
    fair = brightest >= LEAST_WHITE and max(clipped) <= MOST_CLIPPED
    red, green, blue = (f"{share:.2f}" for share in clipped)
    return f"{shot}: white {brightest}, clipped {red} {green} {blue} %{'' if fair else '  <- relight it'}"


if __name__ == "__main__":
    main()
