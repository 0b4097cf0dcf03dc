"""How good a picture is to be, from a look while working to delivery."""

from __future__ import annotations

from dataclasses import dataclass

from render.errors import BadInputError


@dataclass(frozen=True)
class Quality:
    """What a picture costs and what it is good for.

    width, height   pixels
    samples         paths a pixel; multijitter wants a square number: 4, 16, 64, 256
    depth           vertices a path may have: 2 is direct light alone
    denoise         "none", "frame" (each by itself) or "time" (along the surface's motion as well)
    """

    width: int
    height: int
    samples: int
    depth: int
    denoise: str = "frame"

    def __post_init__(self) -> None:
        if min(self.width, self.height, self.samples) < 1:
            raise BadInputError(
                f"quality: {self.width}×{self.height} pixels, {self.samples} samples; all must be above 0"
            )
        if self.depth < 2:
            raise BadInputError(f"quality has depth {self.depth}; light needs at least 2 to reach the lens")
        if self.denoise not in ("none", "frame", "time"):
            raise BadInputError(f"denoise is {self.denoise!r}; it can be none, frame or time")

    @property
    def aspect(self) -> float:
        return self.width / self.height


QUALITIES = {
    "preview": Quality(480, 270, samples=4, depth=3, denoise="frame"),
    "draft": Quality(480, 270, samples=16, depth=4, denoise="frame"),
    "daily": Quality(960, 540, samples=16, depth=6, denoise="time"),
    "final": Quality(1920, 1080, samples=64, depth=10, denoise="time"),
}
