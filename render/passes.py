"""Passes of a few samples each, averaged: over the sub-frames of a picture, or of its one moment."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from render.aovs import looked_at
from render.errors import BadInputError
from render.quality import Quality
from render.scene import DYE, Rendering, Scenes
from render.shutter import batch_of, passes_of

Layer = NDArray[np.float32]
Picture = NDArray[np.float64]

SPARKLE_FACTOR = 3.0
"""A pixel of one pass may be this much brighter than the third brightest of its eight neighbours."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])

_LUMINANCE, _SQUARE = 4, 7
"""Where Mitsuba's moments have the mean luminance, and that of its square."""


def seed_of(*parts: str | int) -> int:
    """One 32-bit seed from a shot's name, a frame, a pass; Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


@dataclass
class Passes:
    """The passes of a picture, and the sums of what they found.

    count    how many sub-frames share its samples
    on_pass  is told after each pass how many are done, and of how many
    """

    quality: Quality
    count: int
    aovs: Collection[str]
    seed: int
    on_pass: Callable[[int, int], None] | None = None
    _sums: dict[str, Picture] = field(default_factory=dict)
    _terms: dict[str, int] = field(default_factory=dict)
    _done: int = 0
    _batch: list[Picture] = field(default_factory=list)

    def __post_init__(self) -> None:
        if "noise" in self.aovs and self.quality.samples < 2:
            raise BadInputError("layer 'noise' cannot be told from one sample; take samples: 2 or more")
        self._guides = passes_of(self.quality.guides, self.count)
        self._beauty = passes_of(self.quality.samples, self.count)
        self._together = batch_of(self.count * len(self._beauty), self._beauty[0])

    def render(self, scenes: Scenes, marks: Mapping[str, NDArray[np.float32]]) -> None:
        """All passes of one sub-frame. marks: by name (V, 3), what its layers show of the vertices"""
        for index, samples in enumerate(self._guides):
            seed = self._next_seed("guides")
            self._add("guides", _render(scenes.guides, samples, seed))
            if scenes.dyed is not None and index == 0:  # what goes along with points is smooth
                self._add_marks(scenes.dyed, marks, samples, seed)
            self._tell()
        for samples in self._beauty:
            self._add_beauty(_render(scenes.beauty, samples, self._next_seed("beauty")))
            self._tell()

    def layers(self) -> dict[str, Layer]:
        """By name, once all sub-frames have been rendered."""
        means = {name: total / self._terms[name] for name, total in self._sums.items()}
        guides = means["guides"]
        parts = {
            "beauty": means["beauty"],
            "albedo": np.clip(guides[..., 0:3], 0.0, 1.0),
            "normal": guides[..., 7:10],
            "position": guides[..., 4:7],
            "depth": guides[..., 3],
            "matte": np.clip(guides[..., 11], 0.0, 1.0),
        }
        for name in self.aovs:
            if name == "noise":
                parts[name] = _standard_error(means["luminance"], means["square"], self._taken)
            elif name == "samples":
                parts[name] = np.full(guides.shape[:2], self._taken)
            else:
                parts[name] = means[name][..., :2] if name == "motion" else means[name]
        return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in parts.items()}

    @property
    def _taken(self) -> int:
        """Samples of light a pixel, all together, as multijitter rounds them."""
        return sum(_rectangle(samples) for samples in self._beauty) * self.count

    def _add(self, name: str, picture: Picture) -> None:
        self._sums[name] = self._sums[name] + picture if name in self._sums else picture
        self._terms[name] = self._terms.get(name, 0) + 1

    def _add_beauty(self, found: Picture) -> None:
        """Sparkles are looked for once about as many samples as those of a whole pass have come together."""
        self._batch.append(found[..., :3])
        if "noise" in self.aovs:
            self._add("luminance", found[..., _LUMINANCE])
            self._add("square", found[..., _SQUARE])
        if len(self._batch) == self._together:
            whole = self._batch[0] if self._together == 1 else sum(self._batch) / self._together
            self._add("beauty", without_sparkles(np.asarray(whole)))
            self._batch = []

    def _add_marks(
        self, dyed: Rendering, marks: Mapping[str, NDArray[np.float32]], samples: int, seed: int
    ) -> None:
        """The same samples as the guides have, so that what covers a pixel there covers it here."""

        def look(values: NDArray[np.float32]) -> Picture:
            dyed.set("subject", DYE, values)
            return _render(dyed, samples, seed)[..., :3]

        for name, picture in looked_at(marks, look).items():
            self._add(name, picture)

    def _next_seed(self, layer: str) -> int:
        return seed_of(self.seed, self._done, layer)

    def _tell(self) -> None:
        self._done += 1
        if self.on_pass is not None:
            self.on_pass(self._done, self.count * (len(self._guides) + len(self._beauty)))


def without_sparkles(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W, 3) radiance of one pass, lone bright pixels dimmed to the bound that SPARKLE_FACTOR sets.

    A highlight or a thin bright line has at least three bright neighbours at every pixel and passes
    unchanged; a path that found a lamp by luck has none.
    """
    luminance = light @ _LUMA
    height, width = luminance.shape
    padded = np.pad(luminance, 1, mode="edge")
    around = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3) if (y, x) != (1, 1)]
    third = np.partition(np.stack(around), 5, axis=0)[5]
    bound = SPARKLE_FACTOR * third + 1e-3
    return np.asarray(light * (bound / np.maximum(luminance, bound))[..., None], dtype=np.float64)


def _standard_error(mean: Picture, square: Picture, samples: int) -> Picture:
    """(H, W) of the mean of samples that know nothing of each other: s / √n, s² their unbiased variance.

    Multijitter's samples lie more evenly, and the moments of a shutter too, so the error is rather less.
    """
    variance = np.maximum(square - mean * mean, 0.0) * samples / (samples - 1)
    return np.asarray(np.sqrt(variance / samples), dtype=np.float64)


def _rectangle(samples: int) -> int:
    """How many samples multijitter takes that is asked for so many."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)


def _render(rendering: Rendering, samples: int, seed: int) -> Picture:
    import drjit as dr
    import mitsuba as mi

    picture = np.array(
        mi.render(rendering.scene, integrator=rendering.integrator, spp=samples, seed=seed), dtype=np.float64
    )
    dr.flush_malloc_cache()
    return picture
