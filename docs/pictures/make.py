"""The pictures of the README, made of what `flowsculpt` has rendered: `make pictures`.

film.webp        the shots of the film at draft quality, a third of their frames
<shot>.webp      a still of each shot at final quality, halved
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from render.colour import quantise, to_display
from render.image import read_exr

HERE = Path(__file__).parent
RENDERS = Path("renders")
SHOTS = {"A010_cube": 50, "A020_lorenz": 56, "A030_taffy": 54}
"""The shots, and the frame of each that makes its still."""

STEP = 3
MILLISECONDS = 110


def main() -> None:
    film = [picture for shot in SHOTS for picture in _moving(shot)]
    film[0].save(
        HERE / "film.webp",
        save_all=True,
        append_images=film[1:],
        duration=MILLISECONDS,
        loop=0,
        quality=80,
        method=6,
    )
    for shot, frame in SHOTS.items():
        still = _picture(RENDERS / shot / "final" / "frames" / f"{shot}.{frame:04d}.exr")
        still.resize((960, 540), Image.Resampling.LANCZOS).save(HERE / f"{shot}.webp", quality=88, method=6)


def _moving(shot: str) -> list[Image.Image]:
    frames = sorted((RENDERS / shot / "draft" / "frames").glob("*.exr"))
    return [_picture(path) for path in frames[::STEP]]


def _picture(path: Path) -> Image.Image:
    layers, _ = read_exr(path)
    shown: NDArray[np.uint8] = quantise(to_display(layers["beauty"], display="srgb"))
    return Image.fromarray(shown)


if __name__ == "__main__":
    main()
