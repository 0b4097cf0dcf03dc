"""Three shots as they grow, in the docs: `python docs/pictures/steps.py`, previews alone."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml
from PIL import Image

OUT, SIZE = Path(__file__).parent, (480, 270)
SHOTS = OUT.parents[1] / "shots"
PLAIN = ("look", "set", "lights", "breed", "camera")
STEPS: dict[str, tuple[int, tuple[tuple[int, tuple[str, ...]], ...]]] = {
    "B220_landing": (31, ((1, PLAIN[:4]), (2, PLAIN[:4]), (2, ()))),
    "B030_marble": (150, ((1, PLAIN), (1, PLAIN[1:]), (1, ()))),
    "B160_loops": (44, ((1, PLAIN), (2, PLAIN), (3, ()))),
}
"""The frame of a shot, and for each step how many of its flows it has, and what it leaves out."""


def main() -> None:
    for name in sys.argv[1:] or STEPS:
        frame, steps = STEPS[name]
        with tempfile.TemporaryDirectory() as folder:
            pictures = [_drawn(Path(folder), f"{name}_{k}", frame, *step) for k, step in enumerate(steps)]
        sheet = Image.new("RGB", (len(pictures) * SIZE[0], SIZE[1]))
        for k, picture in enumerate(pictures):
            sheet.paste(picture, (k * SIZE[0], 0))
        sheet.save(OUT / f"{name}_steps.webp", quality=86, method=6)


def _drawn(folder: Path, name: str, frame: int, flows: int, left_out: tuple[str, ...]) -> Image.Image:
    """Return the preview of a shot with some of its flows and without some of its entries."""
    shot: dict[str, Any] = yaml.safe_load((SHOTS / f"{name[:-2]}.yaml").read_text(encoding="utf-8"))
    kept = {entry: value for entry, value in shot.items() if entry not in left_out}
    step, picture = folder / f"{name}.yaml", folder / f"{name}.png"
    text = yaml.safe_dump({**kept, "flows": shot["flows"][:flows]}, sort_keys=False)
    step.write_text(text, encoding="utf-8")
    words = ["--root", str(folder), "preview", str(step), "--at", str(frame), "-o", str(picture)]
    subprocess.run([sys.executable, "-m", "flowsculpt", *words], check=True)
    return Image.open(picture).convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
