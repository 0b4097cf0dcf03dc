"""The README's moving picture, of what `make film` has rendered: `make pictures`."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.image import read_exr

HERE = Path(__file__).parent
SHOTS = ("A010_cube", "A020_lorenz", "A030_taffy")
STEP = 3
MILLISECONDS = 125
QUALITY = 92


def main() -> None:
    first, *others = (picture for shot in SHOTS for picture in _moving(shot))
    first.save(
        HERE / "film.webp",
        save_all=True,
        append_images=others,
        duration=MILLISECONDS,
        loop=0,
        quality=QUALITY,
        method=6,
        kmax=1,  # whole pictures: parts that change little would be left as blocks of the picture before
    )


def _moving(shot: str) -> list[Image.Image]:
    """Every third frame of a shot, as a page shows it."""
    frames = sorted(Path("renders", shot, "draft", "frames").glob("*.exr"))
    return [_picture(path) for path in frames[::STEP]]


def _picture(path: Path) -> Image.Image:
    layers, _ = read_exr(path)
    return Image.fromarray(quantise(to_display(layers["beauty"], display="srgb")))


if __name__ == "__main__":
    main()
