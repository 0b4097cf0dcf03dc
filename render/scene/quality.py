"""How good a picture is to be, from a look while working to delivery."""

from __future__ import annotations

import math
from dataclasses import dataclass

from render.base.errors import BadInputError

PASS_SAMPLES = 16
"""Samples a pixel in one pass; a square, as multijitter wants, and a power of two, as our sequence does."""

FEWEST_ADAPTIVE = 3 * PASS_SAMPLES
"""Samples of a picture that may stop earlier: two passes tell its noise, and a third one can be saved."""

MOST_TEMPORAL_FRAMES = 4
"""Frames to either side that a picture may take light from."""

Crop = tuple[int, int, int, int]
"""The pixels that are rendered, from the upper left of the picture: x0, y0, x1, y1; these two are outside."""


@dataclass(frozen=True)
class Quality:
    """What a picture costs and what it is good for.

    width, height   pixels
    samples         paths a pixel; the plain variant rounds up to a rectangle: 4, 6, 9, 16, 64
    noise_threshold the noise (see `adaptive.noise_of`) that is quiet enough: passes end there, or with
                    `samples` at the latest; None takes them all
    auxiliary_samples  samples a pixel of albedo, normal, position and depth, whose only noise is at edges
    depth           vertices a path may have: 2 is direct light alone
    crop            the part of the picture that is rendered; None is all of it
    denoise         "off", or the denoiser's effort: "fast", "balanced" or "high"
    temporal_denoise  frames before and after that the temporal denoiser reprojects; 0 is off: see
                    `render.post.temporal_denoise`
    """

    width: int
    height: int
    samples: int
    depth: int
    auxiliary_samples: int = 16
    denoise: str = "high"
    temporal_denoise: int = 0
    crop: Crop | None = None
    noise_threshold: float | None = None

    def __post_init__(self) -> None:
        for name in ("width", "height", "samples", "auxiliary_samples"):
            if getattr(self, name) < 1:
                raise BadInputError(f"quality has {name} {getattr(self, name)}; it must be at least 1")
        for name in ("samples", "auxiliary_samples"):
            if (count := getattr(self, name)) > PASS_SAMPLES and count % PASS_SAMPLES:
                raise BadInputError(
                    f"{count} {name} do not divide into passes of {PASS_SAMPLES}; take {PASS_SAMPLES}, "
                    f"{2 * PASS_SAMPLES}, {4 * PASS_SAMPLES}, …"
                )
        self._check_threshold()
        if self.depth < 2:
            raise BadInputError(f"quality has depth {self.depth}; light needs at least 2 to reach the lens")
        if self.denoise not in ("off", "fast", "balanced", "high"):
            raise BadInputError(f"denoise is {self.denoise!r}; it can be off, fast, balanced or high")
        if not 0 <= self.temporal_denoise <= MOST_TEMPORAL_FRAMES:
            raise BadInputError(
                f"quality has temporal_denoise {self.temporal_denoise}; it must be from 0 to "
                f"{MOST_TEMPORAL_FRAMES} frames"
            )
        if self.crop is not None:
            x0, y0, x1, y1 = self.crop
            if not (0 <= x0 < x1 <= self.width and 0 <= y0 < y1 <= self.height):
                raise BadInputError(
                    f"crop {x0},{y0},{x1},{y1} is no part of {self.width} × {self.height} pixels"
                )

    def _check_threshold(self) -> None:
        threshold = self.noise_threshold
        if threshold is None:
            return
        if not (math.isfinite(threshold) and threshold > 0.0):
            raise BadInputError(f"quality has noise_threshold {threshold}; it must be above 0, such as 0.02")
        if self.samples < FEWEST_ADAPTIVE:
            raise BadInputError(
                f"noise_threshold has no pass to save of {self.samples} samples; "
                f"take {FEWEST_ADAPTIVE} or more"
            )

    @property
    def rendered_size(self) -> tuple[int, int]:
        """Width and height of what is rendered: the picture, or the part of it."""
        x0, y0, x1, y1 = self.crop or (0, 0, self.width, self.height)
        return x1 - x0, y1 - y0

    @property
    def aspect(self) -> float:
        return self.width / self.height


QUALITIES = {
    "preview": Quality(480, 270, samples=4, depth=3, auxiliary_samples=4, denoise="balanced"),
    "draft": Quality(480, 270, samples=4, depth=4, auxiliary_samples=4, denoise="balanced"),
    "daily": Quality(960, 540, samples=16, depth=6, auxiliary_samples=16, temporal_denoise=2),
    "final": Quality(1920, 1080, samples=64, depth=10, auxiliary_samples=64, temporal_denoise=2),
}
