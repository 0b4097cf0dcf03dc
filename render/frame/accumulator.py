"""Sums of sample batches and what follows from them: AOVs, noise, whether the frame has converged."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.frame.fireflies import FireflyFilter, find_fireflies, kept_fractions
from render.scene.aovs import COVERAGE, DENOISER, Pixels
from render.scene.light_groups import with_beauty
from render.scene.quality import Quality

Picture = NDArray[np.float64]
PixelNumbers = NDArray[np.int64]
"""Numbers of pixels of the rendered part, row by row from its upper left."""

LUMINANCE, SQUARE, GROUPS = 3, 4, 5
"""Channels of a beauty batch after its radiance: mean luminance, mean of its square, and the first of three
for each light group."""

MIN_ROUNDS = 2
"""Rounds needed to compare."""

NOISE_BLOCK = 16
"""Pixels along the side of a block."""

QUIET_FRACTION = 0.95
"""Fraction of the blocks that must be below the threshold, so that the noisiest corner does not decide."""

MIN_LUMINANCE = 0.01
"""Luminance below which noise counts as if the light were this bright."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(eq=False)
class Plane:
    """Sums over the samples of each pixel.

    sums    (pixels, channels)
    counts  (pixels,): samples of each pixel in its sums
    """

    sums: Picture
    counts: NDArray[np.int32]

    def add(self, sums: Picture, samples: int, pixels: PixelNumbers | None) -> None:
        """Add sums (rows, channels) over `samples` samples to `pixels`, one row each; None is all pixels."""
        where = slice(None) if pixels is None else pixels
        self.sums[where] += sums
        self.counts[where] += samples

    def means(self, pixels: PixelNumbers | None = None) -> Picture:
        """Return the means (pixels, channels) of `pixels`, which have had samples; None is all pixels."""
        where = slice(None) if pixels is None else pixels
        return np.asarray(self.sums[where] / self.counts[where, None])


@dataclass
class Accumulator:
    """The sums of the sample batches of one frame, in the order in which they are added.

    The sums of a pixel depend on its own samples only, not on the pixels that are rendered with it.

    quality  of the frame
    aovs     names of AOVs beyond those of all frames
    groups   names of light groups
    """

    quality: Quality
    aovs: Collection[str]
    groups: Sequence[str] = ()
    _planes: dict[str, Plane] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if "noise" in self.aovs and self.quality.samples < 2:
            raise BadInputError("AOV 'noise' needs 2 samples or more; the quality has 1")

    def add(self, name: str, means: Picture, samples: int, pixels: PixelNumbers | None = None) -> None:
        """Add a batch to the plane `name`.

        name     "beauty": radiance, the channels LUMINANCE and SQUARE, and those of light groups; "coverage":
                 alpha and the coverage of each object; or a feature (see `FeatureTracer.render`)
        means    over `samples` samples: (H, W, channels), or (pixels, channels) for `pixels`
        pixels   numbers of pixels; None is all of them

        Values that are not finite, as of a degenerate triangle, count as 0.
        """
        rows = np.nan_to_num(means.reshape(-1, means.shape[-1]), posinf=0.0, neginf=0.0)
        self._plane(name, rows.shape[1]).add(rows * samples, samples, pixels)
        if name == "beauty" and self.quality.noise_threshold is not None:
            self._plane("round", 1).add(rows[:, :3] @ _LUMA[:, None] * samples, samples, pixels)

    def end_round(self) -> None:
        """Compare the samples since the last call, of which each motion sample has had equally many."""
        if self.quality.noise_threshold is None:
            return
        latest = self._planes.pop("round")
        pixels = np.flatnonzero(latest.counts)
        luminance = latest.means(pixels)
        self._plane("rounds", 2).add(np.concatenate([luminance, luminance * luminance], axis=1), 1, pixels)

    def frame_aovs(self, objects: Sequence[str] = ()) -> dict[str, Pixels]:
        """Return the AOVs by name, once all motion samples have been rendered.

        objects  names of the objects whose coverage our path tracer measures
        """
        means = {name: self._pictures(name) for name in self._planes}
        beauty = means["beauty"]
        samples = self._planes["beauty"].counts.reshape(beauty.shape[:2])
        arrays: dict[str, NDArray[Any]] = {
            **self._light(beauty),
            "albedo": np.clip(means["albedo"], 0.0, 1.0),
            "normal": means["normal"],
            "position": means["position"],
            "depth": means["depth"][..., 0],
            "matte": np.clip(means["matte"][..., 0], 0.0, 1.0),
        }
        if "coverage" in means:
            names = ["alpha", *(f"{COVERAGE}{name}" for name in objects)]
            arrays |= zip(names, np.moveaxis(means["coverage"], 2, 0), strict=True)
        followed = {name: means[name] for name in DENOISER if name in means}
        if any(not np.array_equal(means[name.removeprefix("denoise_")], followed[name]) for name in followed):
            arrays |= followed
        for name in self.aovs:
            if name == "noise":
                arrays[name] = _standard_error(beauty[..., LUMINANCE], beauty[..., SQUARE], samples)
            elif name == "samples":
                arrays[name] = samples
            else:
                arrays[name] = means[name][..., :2] if name == "motion" else means[name]
        return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}

    def _light(self, beauty: Picture) -> dict[str, Pixels]:
        """Return the beauty and the light groups, with fireflies treated as the quality says."""
        fireflies = self.fireflies()
        if not self.groups:
            return {"beauty": fireflies.apply(beauty[..., :3]).astype(np.float32)}
        parts = np.split(fireflies.apply(beauty[..., GROUPS:]), len(self.groups), axis=2)
        return with_beauty(dict(zip(self.groups, parts, strict=True)))

    def facts(self) -> dict[str, float]:
        """Return the samples per pixel, the light of fireflies and, with adaptive sampling, the noise."""
        light = self.fireflies().facts(self._pictures("beauty")[..., LUMINANCE])
        if self.quality.noise_threshold is None:
            return {"samples": self.quality.samples, **light}
        noise = {"noise": float(f"{self._noise:.4g}")} if self._is_comparable else {}
        return {"samples": int(self._planes["beauty"].counts.max()), **light, **noise}

    def fireflies(self) -> FireflyFilter:
        """Return the filter that takes fireflies from the beauty, and from light groups alike."""
        matte = self._pictures("matte")[..., 0]
        return find_fireflies(*self._moments(), matte, self.quality.fireflies)

    def _moments(self) -> tuple[Picture, Picture, Picture]:
        """Return the beauty's mean luminance, mean squared luminance and number of samples, (H, W) each."""
        beauty = self._pictures("beauty")
        samples = self._planes["beauty"].counts.reshape(beauty.shape[:2])
        return beauty[..., LUMINANCE], beauty[..., SQUARE], samples.astype(np.float64)

    @property
    def has_converged(self) -> bool:
        """True if the noise is at most the quality's threshold, between rounds."""
        threshold = self.quality.noise_threshold
        if threshold is None or "round" in self._planes:
            return False
        return self._is_comparable and self._noise <= threshold

    @property
    def _is_comparable(self) -> bool:
        rounds = self._planes.get("rounds")
        return rounds is not None and int(rounds.counts.min()) >= MIN_ROUNDS

    @property
    def _noise(self) -> float:
        width, height = self.quality.rendered_size
        rounds = self._planes["rounds"]
        total, squares = rounds.sums.T.reshape(2, height, width)
        kept = kept_fractions(*self._moments(), self.quality.fireflies)
        return noise_of(total * kept, squares * kept * kept, int(rounds.counts.max()))

    def _pictures(self, name: str) -> Picture:
        """Return the means (H, W, channels) of a plane."""
        width, height = self.quality.rendered_size
        return self._planes[name].means().reshape(height, width, -1)

    def _plane(self, name: str, channels: int) -> Plane:
        """Return a plane, which is added where it is missing."""
        if name not in self._planes:
            width, height = self.quality.rendered_size
            count = width * height
            self._planes[name] = Plane(np.zeros((count, channels)), np.zeros(count, dtype=np.int32))
        return self._planes[name]

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything, for a checkpoint."""
        sums = {f"sums:{name}": plane.sums for name, plane in self._planes.items()}
        counts = {f"counts:{name}": plane.counts for name, plane in self._planes.items()}
        return {**sums, **counts}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned."""
        names = [key.removeprefix("sums:") for key in state if key.startswith("sums:")]
        self._planes = {name: Plane(state[f"sums:{name}"], state[f"counts:{name}"]) for name in names}


def _standard_error(mean: Picture, square: Picture, samples: NDArray[np.int32]) -> Picture:
    """Return the standard error (H, W) of the mean of independent samples: s / √n, s² unbiased.

    Our samples are spread more evenly, and so are motion samples: their error is rather less.
    """
    variance = np.maximum(square - mean * mean, 0.0) * samples / (samples - 1)
    return np.asarray(np.sqrt(variance / samples), dtype=np.float64)


def noise_of(total: Picture, squares: Picture, count: int) -> float:
    """Return the noise of the mean of `count` batches, from the sums (H, W) of their luminance Y and of Y².

    After Dammertz, Hanika, Keller and Lensch, *A hierarchical automatic stopping condition for Monte Carlo
    global illumination* (2010): the error is measured in blocks, over the square root of the light, which is
    about what a display shows. They compare a picture with one of half its samples. Here all batches are
    compared with their mean, so that the even spread of samples counts, which single samples do not show.

    The noise of a block of 16 × 16 pixels is √(mean s² / count / mean Y), where s² is a pixel's unbiased
    variance between batches; 19 of 20 blocks have at most the returned noise. A display shows about half of
    it: 0.02 there is a standard deviation of 2 to 3 steps of 255.
    """
    variance = np.maximum(squares - total * total / count, 0.0) / (count - 1)
    error = _block_means(variance) / count
    light = np.maximum(_block_means(total) / count, MIN_LUMINANCE)
    return float(np.quantile(np.sqrt(error / light), QUIET_FRACTION, method="inverted_cdf"))


def _block_means(picture: Picture) -> Picture:
    """Return the mean of each block; blocks at the right and lower edge may be smaller."""
    rows, columns = (np.arange(0, side, NOISE_BLOCK) for side in picture.shape)
    sums = np.add.reduceat(np.add.reduceat(picture, rows, axis=0), columns, axis=1)
    heights, widths = np.diff(rows, append=picture.shape[0]), np.diff(columns, append=picture.shape[1])
    return np.asarray(sums / (heights[:, None] * widths), dtype=np.float64)
