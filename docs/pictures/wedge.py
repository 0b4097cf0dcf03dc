"""The contact sheet of docs/versions.md: `make pictures`, or this file. `--root` says where to render."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parent / "wedge.webp"
WEDGE = ("A010_cube", "--vary", "flows.1.twist.amount.keys.57=0:160:3", "--vary", "look=clay,glaze,chrome")
FRAME = 44


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    root = parser.parse_args().root
    words = ["--json", "--root", str(root), "wedge", *WEDGE, "--at", str(FRAME)]
    said = subprocess.run([sys.executable, "-m", "pipeline.cli", *words], check=True, stdout=subprocess.PIPE)
    with Image.open(root / json.loads(said.stdout)["sheets"][0]) as sheet:
        sheet.convert("RGB").save(OUT, quality=86, method=6)


if __name__ == "__main__":
    main()
