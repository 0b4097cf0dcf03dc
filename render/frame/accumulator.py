"""Sums of sample batches and what follows from them: AOVs, noise, whether the frame has converged."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.feature_edges import LIMITS, at_edges
from flowsculpt.render.frame.fireflies import FireflyFilter, find_fireflies, kept_fractions
from flowsculpt.render.frame.sample_sums import SampleSums
from flowsculpt.render.frame.tiles import Picture, PixelNumbers, TileMask, Tiles, noise_of_tiles
from flowsculpt.render.scene.aovs import COPIES, COVERAGE, DENOISER, MOST_RANKS, Pixels
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import with_beauty

LUMINANCE, SQUARE, GROUPS = 3, 4, 5
"""Channels of a beauty batch after its radiance: mean luminance, mean of its square, and the first of three
for each light group."""

MIN_ROUNDS = 2
"""Rounds needed to compare."""

MIN_OUTLINE = 1e-3
"""Mean of coverage times what it leaves, in a tile that the subject's outline crosses."""

MIN_EDGE = 3e-4
"""Mean of |n|² (1 − |n|²) in a tile with edges, n being the mean normal of a pixel: a pixel that sees two
faces has a shorter one."""

EDGE_WEIGHT, STAGE_WEIGHT = 3.5, 1.6
"""Factors on the noise of tiles with edges, and of those without the subject, before it is compared with the
threshold. Edges are a tenth of the tiles and hold half of the error that the denoiser leaves; a sample of the
stage takes a third of the time of one of the subject."""

MAX_EDGE_FRACTION = 0.125
"""Most of the tiles that may have edges for these to take more than the samples of a quality: where there are
more, the picture would take more time than without adaptive sampling."""

QUIET_FRACTION = 0.95
"""Fraction of the tiles whose noise the noise of a frame is at least, so that the noisiest corner does not
decide."""


@dataclass
class Accumulator:
    """The sums of the sample batches of one frame, in the order in which they are added.

    The sums of a pixel depend on its own samples only, not on the pixels that are rendered with it.

    quality  of the frame
    aovs     names of AOVs beyond those of all frames
    groups   names of light groups
    copies   the copies of subjects that pixels show; None where they are not told apart
    """

    quality: Quality
    aovs: Collection[str]
    groups: Sequence[str] = ()
    copies: CopyCounts | None = None
    _planes: dict[str, SampleSums] = field(default_factory=dict)
    _active: TileMask | None = None
    _tiles: Tiles = field(init=False)

    def __post_init__(self) -> None:
        self._tiles = Tiles.of(self.quality)
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
        rows = means.reshape(-1, means.shape[-1])
        self._plane(name, rows.shape[1], rows.dtype).add(rows, samples, pixels)
        if name == "beauty" and self.quality.noise_threshold is not None:
            self._plane("round", 1).add(rows[:, LUMINANCE, None], samples, pixels)
        if name in ("matte", "normal"):
            vars(self).pop("_outlines", None)

    def add_copies(self, seen: NDArray[np.int32], pixels: PixelNumbers | None = None) -> None:
        """Add the copies (pixels, samples) that the samples of a beauty batch see, as of `CopyTracer`."""
        self.copies = self.copies or CopyCounts()
        self.copies.add(seen, pixels)

    def end_round(self, by_tile: bool) -> None:
        """Compare the samples since the last call, of which each motion sample has had equally many, with
        those of earlier rounds; and stop tiles whose noise is at most the threshold.

        by_tile  False stops no tile before the noise of the frame is at most the threshold

        The noise of a tile counts its neighbours, so that none stops by chance amid noise. Tiles on the
        subject's outline take all samples, so that alpha is smooth in front of anything. After these, only
        edges go on.
        """
        latest = self._planes.pop("round")
        pixels = np.flatnonzero(latest.counts)
        squares = latest.sums[pixels] ** 2 / latest.counts[pixels, None]
        self._plane("rounds", 1).add(squares, 1, pixels)
        threshold = self.quality.noise_threshold
        if threshold is None or not self._is_comparable:
            return
        if by_tile:
            active = np.ones(self._tiles.shape, dtype=bool) if self._active is None else self._active
            outline, edges, weights = self._outlines
            is_noisy = self._noise(smooth=True) * weights > threshold
            counts = self._planes["beauty"].counts.astype(np.float64)
            may_go_on = self._tiles.means(counts) < self.quality.samples
            if edges.mean() <= MAX_EDGE_FRACTION:
                may_go_on |= edges & is_noisy
            self._active = active & may_go_on & (is_noisy | outline)
        else:
            self._active = np.full(self._tiles.shape, _of_frame(self._noise()) > threshold)

    @property
    def active_pixels(self) -> PixelNumbers:
        """The pixels that take more samples, tile by tile."""
        return self._tiles.pixels(self._active)

    @property
    def all_pixels(self) -> PixelNumbers:
        """All pixels, tile by tile."""
        return self._tiles.pixels(None)

    @property
    def edge_pixels(self) -> PixelNumbers:
        """The pixels at edges of the features sampled so far, tile by tile."""
        names = LIMITS.keys() & self._planes.keys()
        edges = at_edges({name: self._pictures(name, np.float32) for name in names})
        return self._tiles.ordered(edges.ravel())

    @property
    def has_converged(self) -> bool:
        """True if adaptive sampling has stopped all tiles."""
        return self._active is not None and not self._active.any()

    def frame_aovs(self, objects: Sequence[str] = ()) -> dict[str, Pixels]:
        """Return the AOVs by name, once all motion samples have been rendered.

        objects  names of the objects whose coverage our path tracer measures
        """
        exact = ("beauty", "coverage")  # what is computed with, and not only written
        means = {
            name: self._pictures(name, np.float64 if name in exact else np.float32) for name in self._planes
        }
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
            alpha, *planes = np.moveaxis(means["coverage"], 2, 0)
            covered = {f"{COVERAGE}{name}": plane for name, plane in zip(objects, planes, strict=False)}
            arrays |= {"alpha": alpha, **covered}
            if len(planes) > len(objects):
                arrays["shadow"] = covered[f"{COVERAGE}stage"] * _shadow(*planes[len(objects) :])
        if self.copies is not None:
            arrays |= self.copies.layers(samples)
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
        fireflies = self._fireflies
        if not self.groups:
            return {"beauty": fireflies.apply(beauty[..., :3]).astype(np.float32)}
        parts = np.split(fireflies.apply(beauty[..., GROUPS:]), len(self.groups), axis=2)
        return with_beauty(dict(zip(self.groups, parts, strict=True)))

    def facts(self) -> dict[str, float]:
        """Return the samples per pixel, the light of fireflies and, with adaptive sampling, the noise."""
        light = self._fireflies.facts(self._moments()[0])
        if self.quality.noise_threshold is None:
            return {"samples": self.quality.samples, **light}
        noise = {"noise": float(f"{_of_frame(self._noise()):.4g}")} if self._is_comparable else {}
        samples = round(float(self._planes["beauty"].counts.mean()), 2)
        return {"samples": samples, **light, **noise}

    @cached_property
    def _fireflies(self) -> FireflyFilter:
        """The filter that takes fireflies from the beauty, and from light groups alike, once all is added."""
        matte = self._pictures("matte", np.float32)[..., 0]
        return find_fireflies(*self._moments(), matte, self.quality.fireflies)

    def _moments(self) -> tuple[Picture, Picture, Picture]:
        """Return the beauty's mean luminance, mean squared luminance and number of samples, (H, W) each."""
        beauty, (width, height) = self._planes["beauty"], self.quality.rendered_size
        luminance, square = (beauty.means(slice(each, each + 1)) for each in (LUMINANCE, SQUARE))
        parts = (luminance, square, beauty.counts.astype(np.float64))
        first, second, third = (part.reshape(height, width) for part in parts)
        return first, second, third

    @property
    def _is_comparable(self) -> bool:
        rounds = self._planes.get("rounds")
        return rounds is not None and int(rounds.counts.min()) >= MIN_ROUNDS

    @cached_property
    def _outlines(self) -> tuple[TileMask, TileMask, Picture]:
        """Tiles that the subject's outline crosses, those with edges, and factors on the noise of all tiles.

        Edges are creases, folds and outlines. All is found again once features are added.
        """
        outline = is_stage = np.zeros(self._tiles.shape, dtype=bool)
        if "matte" in self._planes:
            matte = self._planes["matte"].means()[:, 0]
            outline = self._tiles.means(matte * (1.0 - matte)) > MIN_OUTLINE
            is_stage = self._tiles.means(matte) == 0.0
        edges = outline
        if "normal" in self._planes:
            squares = np.sum(self._planes["normal"].means() ** 2, axis=1)
            edges = outline | (self._tiles.means(squares * np.maximum(1.0 - squares, 0.0)) > MIN_EDGE)
        return outline, edges, np.select([edges, is_stage], [EDGE_WEIGHT, STAGE_WEIGHT], 1.0)

    def _noise(self, smooth: bool = False) -> Picture:
        """Return the noise (rows, columns) of the tiles.

        Fireflies are left out: the denoiser removes them, and more samples would find others.

        smooth  as of `noise_of_tiles`

        The variance of a mean of rounds is that between them, weighted by their samples.
        """
        rounds, moments = self._planes["rounds"], self._moments()
        mean, samples = moments[0].ravel(), moments[2].ravel()
        variance = np.maximum(rounds.sums[:, 0] / samples - mean * mean, 0.0) / (rounds.counts - 1)
        kept = kept_fractions(*moments, self.quality.fireflies).ravel()
        return noise_of_tiles(self._tiles, mean * kept, variance * (kept == 1.0), smooth)

    def _pictures(self, name: str, kind: type) -> NDArray[Any]:
        """Return the means (H, W, channels) of a plane, in a type."""
        width, height = self.quality.rendered_size
        return self._planes[name].means(kind=kind).reshape(height, width, -1)

    def _plane(self, name: str, channels: int, kind: Any = np.float64) -> SampleSums:
        """Return a plane, which is added where it is missing."""
        if name not in self._planes:
            width, height = self.quality.rendered_size
            self._planes[name] = SampleSums.zeros(width * height, channels, kind)
        return self._planes[name]

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything, for a checkpoint."""
        sums = {f"sums:{name}": plane.sums for name, plane in self._planes.items()}
        counts = {f"counts:{name}": plane.counts for name, plane in self._planes.items()}
        active = {} if self._active is None else {"active": self._active}
        return {**sums, **counts, **active, **({} if self.copies is None else self.copies.state())}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned."""
        names = [key.removeprefix("sums:") for key in state if key.startswith("sums:")]
        self._planes = {name: SampleSums(state[f"sums:{name}"], state[f"counts:{name}"]) for name in names}
        self._active = state.get("active")
        self.copies = CopyCounts.restored(state)


def _of_frame(noise: Picture) -> float:
    """Return the noise of a frame, from that of its tiles."""
    return float(np.quantile(noise, QUIET_FRACTION, method="inverted_cdf"))


def _shadow(lit: Picture, bare: Picture) -> Picture:
    """Return the part of the light that is missing, from luminances with and without what casts shadows."""
    return np.asarray(1.0 - np.divide(lit, bare, out=np.ones_like(lit), where=bare > 0.0))


def _standard_error(mean: Picture, square: Picture, samples: NDArray[np.int32]) -> Picture:
    """Return the standard error (H, W) of the mean of independent samples: s / √n, s² unbiased.

    Our samples are spread more evenly, and so are motion samples: their error is rather less.
    """
    variance = np.maximum(square - mean * mean, 0.0) * samples / (samples - 1)
    return np.asarray(np.sqrt(variance / samples), dtype=np.float64)


_NUMBERS = 1 << 20
"""More than the numbers of copies: a cell is the number of a pixel, times this, plus that of a copy."""

_NO_CELLS = np.empty(0, np.int64)


@dataclass
class CopyCounts:
    """Samples of each pixel that see each copy of subjects, held only where a sample sees one.

    cells   ascending, (C,): pixel and copy
    counts  (C,) of samples
    """

    cells: NDArray[np.int64] = field(default_factory=_NO_CELLS.copy)
    counts: NDArray[np.int64] = field(default_factory=_NO_CELLS.copy)

    def add(self, seen: NDArray[np.int32], pixels: NDArray[np.integer[Any]] | None = None) -> None:
        """Add the copies (pixels, samples) that samples see, 0 for none, of `pixels`; None is all pixels."""
        numbers = np.arange(len(seen)) if pixels is None else pixels
        rows, columns = np.nonzero(seen)
        latest = numbers[rows].astype(np.int64) * _NUMBERS + seen[rows, columns]
        cells, counts = np.unique(latest, return_counts=True)
        together, places = np.unique(np.concatenate([self.cells, cells]), return_inverse=True)
        weights = np.concatenate([self.counts, counts])
        self.cells, self.counts = together, np.bincount(places, weights, len(together)).astype(np.int64)

    def layers(self, samples: NDArray[np.integer[Any]]) -> dict[str, Pixels]:
        """Return layers (H, W, 4) of number and coverage of two copies each, the greatest coverage first.

        samples  (H, W) of each pixel

        Where nothing is left, the number is 0. Copies beyond MOST_RANKS are left out.
        """
        pixels, copies = np.divmod(self.cells, _NUMBERS)
        order = np.lexsort((copies, -self.counts, pixels))
        pixels, copies, counts = pixels[order], copies[order], self.counts[order]
        rank = np.arange(len(pixels)) - np.searchsorted(pixels, pixels)
        kept = rank < MOST_RANKS
        ranked = np.zeros((samples.size, MOST_RANKS, 2), np.float32)
        ranked[pixels[kept], rank[kept], 0] = copies[kept]
        ranked[pixels[kept], rank[kept], 1] = counts[kept] / samples.ravel()[pixels[kept]]
        planes = ranked.reshape(*samples.shape, MOST_RANKS // 2, 4)
        return {f"{COPIES}{index:02d}": planes[:, :, index] for index in range(MOST_RANKS // 2)}

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything, for a checkpoint."""
        return {"copies:cells": self.cells, "copies:counts": self.counts}

    @classmethod
    def restored(cls, state: Mapping[str, NDArray[Any]]) -> CopyCounts | None:
        """Return what `state` returned; None where there were none."""
        return cls(state["copies:cells"], state["copies:counts"]) if "copies:cells" in state else None
