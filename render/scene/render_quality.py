"""Quality settings of a rendered frame, from first looks to delivery."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from flowsculpt.render.base.render_errors import BadInputError

if TYPE_CHECKING:  # it needs numpy, and planning knows qualities without it
    from flowsculpt.render.scene.render_camera import Projection

BATCH_SAMPLES = 16
"""Samples per pixel of a full sample batch: a square for multijitter, a power of two for our sequence."""

MIN_ADAPTIVE_SAMPLES = 9
"""Fewest samples with a noise threshold: 8 measure the noise, and another can be saved."""

TYPICAL_FRACTION = 0.625
"""Fraction of the most samples that a typical frame takes with adaptive sampling."""

MOST_TEMPORAL_FRAMES = 4
"""Most frames to either side that temporal denoising may read."""

CONVENTIONS = ("blender", "arnold", "nuke")
"""Programs whose names the channels of finished frames can have (`flowsculpt.render.post.exr_names`)."""

Crop = tuple[int, int, int, int]
"""Rendered pixels x0, y0, x1, y1 from the picture's upper left; x1 and y1 are excluded."""


@dataclass(frozen=True)
class Quality:
    """Resolution, sampling and denoising of a frame.

    width, height      pixels
    samples            paths per pixel; the scalar variant rounds up to a rectangle: 4, 6, 9, 16, 64
    depth              most vertices of a path: 2 is direct light alone
    auxiliary_samples  samples per pixel of albedo, normal, position and depth where these have edges; a still
                       picture takes fewer elsewhere (`frame.batch_schedule`)
    fireflies          "keep" leaves them, "soft" spreads their light over the surroundings, "firm" removes it
    denoise            "off", or the denoiser's effort: "fast", "balanced" or "high"
    temporal_denoise   frames before and after that temporal denoising reprojects; 0 is off
    crop               rendered part of the picture; None is all of it
    noise_threshold    noise (`frame.tiles`) at which adaptive sampling stops a tile; `samples` is the most
                       then. None takes `samples` everywhere
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
    fireflies: str = "soft"

    def __post_init__(self) -> None:
        for name in ("width", "height", "samples", "auxiliary_samples"):
            if getattr(self, name) < 1:
                raise BadInputError(f"quality has {name} {getattr(self, name)}; it must be at least 1")
        for name in ("samples", "auxiliary_samples"):
            if (count := getattr(self, name)) > BATCH_SAMPLES and count % BATCH_SAMPLES:
                raise BadInputError(
                    f"{count} {name} do not divide into batches of {BATCH_SAMPLES}; use {BATCH_SAMPLES}, "
                    f"{2 * BATCH_SAMPLES}, {4 * BATCH_SAMPLES}, …"
                )
        if (limit := self.noise_threshold) is not None and not (math.isfinite(limit) and limit > 0.0):
            raise BadInputError(f"quality has noise_threshold {limit}; it must be above 0, such as 0.02")
        if self.depth < 2:
            raise BadInputError(f"quality has depth {self.depth}; light needs at least 2 to reach the lens")
        if self.denoise not in ("off", "fast", "balanced", "high"):
            raise BadInputError(f"denoise is {self.denoise!r}; it can be off, fast, balanced or high")
        if self.fireflies not in ("keep", "soft", "firm"):
            raise BadInputError(f"fireflies is {self.fireflies!r}; it can be keep, soft or firm")
        if not 0 <= self.temporal_denoise <= MOST_TEMPORAL_FRAMES:
            raise BadInputError(
                f"quality has temporal_denoise {self.temporal_denoise}; it must be from 0 to "
                f"{MOST_TEMPORAL_FRAMES} frames"
            )
        if self.crop is not None:
            x0, y0, x1, y1 = self.crop
            if not (0 <= x0 < x1 <= self.width and 0 <= y0 < y1 <= self.height):
                raise BadInputError(
                    f"crop {x0},{y0},{x1},{y1} is not within {self.width} × {self.height} pixels"
                )

    @property
    def is_adaptive(self) -> bool:
        """True if parts of the picture take fewer than `samples`."""
        return self.noise_threshold is not None and self.samples >= MIN_ADAPTIVE_SAMPLES

    @property
    def typical_samples(self) -> float:
        """The samples per pixel that a typical frame takes."""
        return max(TYPICAL_FRACTION * self.samples, 8.0) if self.is_adaptive else self.samples

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole picture."""
        return self.width, self.height

    @property
    def rendered_size(self) -> tuple[int, int]:
        """Width and height of the rendered part."""
        x0, y0, x1, y1 = self.crop or (0, 0, self.width, self.height)
        return x1 - x0, y1 - y0

    @property
    def aspect(self) -> float:
        """Width over height of the whole picture."""
        return self.width / self.height


QUALITIES = {
    "draft": Quality(480, 270, samples=4, depth=4, denoise="balanced"),
    "daily": Quality(960, 540, samples=16, depth=6, auxiliary_samples=16, temporal_denoise=2),
    "final": Quality(
        1920, 1080, samples=64, depth=10, auxiliary_samples=64, temporal_denoise=2, noise_threshold=0.05
    ),
}
"""The qualities that every shot has, by their names, the quickest first."""

WIDE_SIZES = {
    "spherical": {"draft": (640, 320), "daily": (1920, 960), "final": (4096, 2048)},
    "dome": {"draft": (384, 384), "daily": (1024, 1024), "final": (2048, 2048)},
    "vr180": {"draft": (768, 384), "daily": (2048, 1024), "final": (4096, 2048)},
}
"""Width and height of pictures with a wide projection, by its kind and the quality. They show several times
the angle of a perspective, and players show a part of them at a time."""


def qualities_for(projection: Projection, final: tuple[int, int] | None = None) -> dict[str, Quality]:
    """Return QUALITIES with the sizes of a projection, or of flat pictures with another size in `final`."""
    if final is not None:
        return qualities_of_size(*final)
    sizes = WIDE_SIZES.get(projection.kind, {})
    return {
        name: replace(quality, width=sizes[name][0], height=sizes[name][1]) if sizes else quality
        for name, quality in QUALITIES.items()
    }


def flat_qualities(qualities: Mapping[str, Quality]) -> dict[str, Quality]:
    """Return qualities with the usual sizes of pictures in perspective."""
    return {
        name: replace(quality, width=QUALITIES[name].width, height=QUALITIES[name].height)
        for name, quality in qualities.items()
    }


def qualities_of_size(width: int, height: int) -> dict[str, Quality]:
    """Return QUALITIES with other pictures in `final`, and as large a part of them as usual in the others."""
    parts = {name: quality.height / QUALITIES["final"].height for name, quality in QUALITIES.items()}
    return {
        name: replace(quality, width=even(width * parts[name]), height=even(height * parts[name]))
        for name, quality in QUALITIES.items()
    }


def final_size(aspect: float) -> tuple[int, int]:
    """Return width and height of `final` pictures of an aspect, whose shorter side is as usual."""
    shorter = QUALITIES["final"].height
    return even(shorter * max(1.0, aspect)), even(shorter * max(1.0, 1.0 / aspect))


def even(pixels: float) -> int:
    """Return the nearest even number of pixels above 0: movies store colours in blocks of 2 × 2."""
    return 2 * max(1, round(pixels / 2.0))


DEFAULT_QUALITY = "draft"
"""The default quality of all commands."""

FORMER_NAMES = {"preview": "draft"}
"""Former names of qualities, which shot files, scripts and versions may still use."""
