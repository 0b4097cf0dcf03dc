"""The pictures of `become` in docs/choreography.md: six frames of each pair, and close-ups.

    python docs/pictures/become.py --models FOLDER --root FOLDER
    python docs/pictures/become.py "ball to cow" "ball to F"   # of these pairs only

`--models` is where the models are that the repository lacks: bunny00.off and cow.off of the CGAL library's
data, mannequin.ply, its mannequin-devil.off with the neck closed, and huesitos.fbx of assimp's test models.
In `--root` shots are written and rendered; what is there already is not made again, nor are fits in the
user's cache.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.become import letter, letter_f, star_prism
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.render.graphics.typesetting import lettering

HERE = Path(__file__).parent
FRAMES = (1, 11, 21, 29, 37, 49)
FRAME, NEAR, CAPTION, FONT = 150, 225, 28, "DroidSans"
SHOT = """\
title: {name}
intent: One shape becomes another.
frames: 1-49
subject: {subject}
resample: {{max_edge_length: {edge}}}
flows: [become: {{{target}, from: 1, to: 49}}]
look: {{material: glaze, colour: [0.55, 0.16, 0.06]}}
lights: porcelain
stage: {{kind: cyclorama, colour: [0.03, 0.05, 0.09]}}
camera: {{azimuth: {azimuth}, elevation: 12}}
"""
BALL, BOX = "solid: icosphere", "solid: box, size: [1.5, 1.5, 1.5]"


@dataclass(frozen=True)
class Pair:
    """A shot of one shape that becomes another, as a shot file has them."""

    name: str
    subject: str
    target: str
    azimuth: float = -25.0
    edge: float = 0.035


def pairs(models: Path, folder: Path) -> list[Pair]:
    """Return all pairs; models are written into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in (("star", star_prism()), ("f", letter_f())):
        write_mesh(mesh, folder / f"{name}.ply")

    def fitted(file: Path) -> str:
        return f"model: {file.absolute()}, fit: 2"

    def written(name: str, text: str, font: str = "DejaVuSans-Bold") -> Pair:
        start, end = (f"model: {file.absolute()}" for file in letter(folder, text, font))
        return Pair(name, start, end, -15.0, 0.02)

    return [
        Pair("box to ball", BOX, BALL),
        Pair("ball to star", BALL, fitted(folder / "star.ply")),
        Pair("ball to bunny", BALL, fitted(models / "bunny00.off"), 0.0),
        Pair("ball to head", BALL, f"{fitted(models / 'mannequin.ply')}, up: z", 25.0),
        Pair("ball to cow", BALL, fitted(models / "cow.off"), -40.0, 0.025),
        Pair("ball to bone", BALL, fitted(models / "huesitos.fbx")),
        Pair("ball to F", BALL, fitted(folder / "f.ply")),
        written("drop to S", "S"),
        written("drop to W", "W"),
        written("ring to P", "P"),
        written("ring to R", "R"),
        written("drop to serif S", "S", "DejaVuSerif-Bold"),
        written("drop to serif W", "W", "DejaVuSerif-Bold"),
        written("rings to &", "&"),
        written("drop to ♪", "♪"),
    ]


CLOSE_UPS = {
    "ball to bunny": {"ears": (0.44, 0.25, 0.42)},
    "ball to head": {"horns and ear": (0.5, 0.35, 0.5)},
    "ball to cow": {"legs": (0.5, 0.7, 0.6), "horns": (0.68, 0.21, 0.36)},
    "ball to F": {"bays": (0.56, 0.36, 0.5)},
}
"""Of a pair, what is seen of it from near in its last frame: the middle of a square, and its side, in heights
of the picture."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="PAIR")
    parser.add_argument("--models", type=Path, default=Path("models"))
    parser.add_argument("--root", type=Path, default=Path("becoming"))
    asked = parser.parse_args()
    rows, near = [], []
    for pair in pairs(asked.models, asked.root / "shots" / "models"):
        if asked.names and pair.name not in asked.names:
            continue
        shot = pair.name.replace(" ", "_").replace("&", "and").replace("♪", "note")
        subject = f"{{{pair.subject}}}"
        words = SHOT.format(
            name=shot, subject=subject, target=pair.target, edge=pair.edge, azimuth=pair.azimuth
        )
        file = asked.root / "shots" / f"{shot}.yaml"
        file.write_text(words, encoding="utf-8")
        print(pair.name, flush=True)
        stills = _stills(asked.root, file, FRAMES, "draft")
        rows.append((pair.name, [_square(still, 0.5, 0.5, 1.0) for still in stills]))
        if near_parts := CLOSE_UPS.get(pair.name):
            (still,) = _stills(asked.root, file, FRAMES[-1:], "daily")
            near += [
                (f"{pair.name}: {part}", _square(still, *where, NEAR)) for part, where in near_parts.items()
            ]
    sheet = np.concatenate([_row(name, pictures) for name, pictures in rows])
    Image.fromarray(sheet).save(HERE / "become.webp", quality=80, method=6)
    if near:
        cells = np.concatenate([_row(name, [picture]) for name, picture in near], axis=1)
        Image.fromarray(cells).save(HERE / "become_near.webp", quality=84, method=6)


def _stills(root: Path, shot: Path, frames: tuple[int, ...], quality: str) -> list[Image.Image]:
    """Return frames of a shot, rendering what is missing."""
    folder = root / "renders" / shot.stem / quality / "png"
    numbers = ",".join(map(str, frames))
    words = [sys.executable, "-m", "flowsculpt", "--root", str(root), "stills", str(shot)]
    subprocess.run([*words, "-f", numbers, "-q", quality], check=True, stdout=subprocess.DEVNULL)
    return [Image.open(folder / f"{shot.stem}.{number:04d}.png").convert("RGB") for number in frames]


def _square(still: Image.Image, x: float, y: float, side: float, size: int = FRAME) -> Image.Image:
    """Return a square part of a picture, from its middle, in parts of its width and height."""
    width, height = still.size
    half = 0.5 * side * height
    box = (x * width - half, y * height - half, x * width + half, y * height + half)
    return still.resize((size, size), Image.Resampling.LANCZOS, box)


def _row(name: str, pictures: list[Image.Image]) -> np.ndarray:
    """Return pictures side by side, with a caption below."""
    row = np.concatenate([np.asarray(picture) for picture in pictures], axis=1)
    caption = np.full((CAPTION, row.shape[1], 3), 250, np.uint8)
    words = lettering(name, FONT, 13)
    above = (CAPTION - words.shape[0]) // 2
    part = caption[above : above + words.shape[0], 6 : 6 + words.shape[1]]
    part -= (215 * words[: part.shape[0], : part.shape[1], None]).astype(np.uint8)
    return np.concatenate([row, caption])


if __name__ == "__main__":
    main()
