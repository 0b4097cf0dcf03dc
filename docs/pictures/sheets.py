"""Sheets in the docs: `make pictures`, or this file. `--root` says where to render."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parent
TWISTS = ("--vary", "flows.1.twist.amount.keys.31=0:160:3", "--vary", "look=clay,glaze,chrome")
SHEETS = {
    "wedge": ("wedge", "A010_cube", *TWISTS, "--at", "44"),
    "turntable": ("turntable", "A030_taffy", "--at", "44", "--frames", "8"),
}
"""By the name of the picture, the command whose first sheet it is."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    parser.add_argument("names", nargs="*", default=list(SHEETS), help="by default all")
    asked = parser.parse_args()
    for name in asked.names:
        words = [sys.executable, "-m", "flowsculpt", "--json", "--root", str(asked.root), *SHEETS[name]]
        said = subprocess.run(words, check=True, stdout=subprocess.PIPE)
        with Image.open(asked.root / json.loads(said.stdout)["sheets"][0]) as sheet:
            sheet.convert("RGB").save(OUT / f"{name}.webp", quality=86, method=6)


if __name__ == "__main__":
    main()
