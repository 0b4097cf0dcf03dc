"""The README's moving picture, of what `make film` has rendered: `make pictures`."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.post.image import read_exr

HERE = Path(__file__).parent
SHOTS = ("A010_cube", "A030_taffy", "A020_lorenz")
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
    """Every third of the frames of a shot that the film shows, with the exposure and the view of the shot."""
    display = read_shot(Path("shots", f"{shot}.yaml")).picture.display
    frames = sorted(Path("renders", shot, "draft", "frames").glob("*.exr"))
    pictures = (read_exr(path)[0]["beauty"] for path in frames[::STEP])
    return [Image.fromarray(display.pixels(picture, "srgb", 8)) for picture in pictures]


if __name__ == "__main__":
    main()
