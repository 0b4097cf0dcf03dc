"""The picture of docs/tutorial.md: a frame of each of its shots, rendered as the page writes them."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

PAGE = Path(__file__).parents[1] / "tutorial.md"
OUT = Path(__file__).parent / "tutorial.webp"
FRAMES = {"A010_first": 50, "A020_bloom": 54}
WIDTH = 640


def flowsculpt(folder: Path, *words: str) -> None:
    """Run a command in a folder."""
    subprocess.run([sys.executable, "-m", "flowsculpt", *words], cwd=folder, check=True)


def main() -> None:
    """Write the shot of the page and the one it begins from a flow; render, and put both side by side."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        flowsculpt(folder, "new", "--show", ".")
        flowsculpt(folder, "new", "A020_bloom", "--from", "curl_noise")
        for name, text in re.findall(r"```yaml\n# (shots/A\w+\.yaml)\n(.*?)```", PAGE.read_text(), re.DOTALL):
            (folder / name).write_text(text)
        pictures = []
        for shot, frame in FRAMES.items():
            flowsculpt(folder, "stills", shot, "-f", str(frame), "-q", "daily")
            (still,) = (folder / "renders" / shot).rglob("*.png")
            picture = Image.open(still).convert("RGB")
            pictures.append(np.asarray(picture.resize((WIDTH, WIDTH * picture.height // picture.width))))
    Image.fromarray(np.hstack(pictures)).save(OUT, quality=88, method=6)


if __name__ == "__main__":
    main()
