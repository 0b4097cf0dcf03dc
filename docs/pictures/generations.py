"""Family trees and sheets of bred shots in docs/choreography.md: `make pictures`, or this file.

`--root` says where generations are bred; those that are there already are not bred again.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parent / "bred"

FAMILIES = {
    "cube": (("A010_cube",), "6", "7,10"),
    "cross": (("A010_cube", "A030_taffy"), "3,5", "1,12"),
}
"""The shots of the first generation, and the children that are the parents of the second and the third."""

WIDTH, SHEET = 1400, 1800
"""Widths of family trees and of the sheet, pixels."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path("renders/generations"))
    parser.add_argument("names", nargs="*", default=list(FAMILIES), help="by default all")
    asked = parser.parse_args()
    for name in asked.names:
        shots, *choices = FAMILIES[name]
        folder = _bred(asked.root / f"{name}_1", *shots)
        for number, parents in enumerate(choices, 2):
            choice = f"{folder} parents={parents} favourites={parents} name={name}_{number}"
            folder = _bred(asked.root / f"{name}_{number}", "--from-page", choice)
        _save(folder / "family.png", f"{name}_family", WIDTH)
        _save(folder / "sheet.png", f"{name}_sheet", SHEET)


def _bred(folder: Path, *words: str) -> Path:
    """Breed a generation into a folder, unless it is there, and return it."""
    if not folder.exists():
        command = [sys.executable, "-m", "flowsculpt", "breed", *words, "-o", str(folder)]
        subprocess.run(command, check=True)
    return folder


def _save(picture: Path, name: str, width: int) -> None:
    with Image.open(picture) as shown:
        height = round(shown.height * width / shown.width)
        smaller = shown.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    smaller.save(OUT / f"{name}.webp", quality=80, method=6)


if __name__ == "__main__":
    main()
