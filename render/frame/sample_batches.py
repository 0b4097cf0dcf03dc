"""Passes of a few samples each, averaged: over the sub-frames of a picture, or of its one moment."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.frame.adaptive_sampling import FEWEST_PASSES, noise_of
from render.frame.checkpoint import Checkpoint
from render.frame.motion_samples import batch_of, passes_of, turns_of
from render.frame.vertex_aovs import looked_at
from render.mitsuba.scene import DYE, Rendering, Scenes
from render.scene.quality import Quality

Layer = NDArray[np.float32]
Picture = NDArray[np.float64]

SPARKLE_FACTOR = 3.0
"""A pixel of one pass may be this much brighter than the third brightest of its eight neighbours."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])

_LUMINANCE, _SQUARE = 3, 4
"""Where a picture of light has the mean luminance, and that of its square."""

_OF_MOMENTS = [0, 1, 2, 4, 7]
"""Where Mitsuba's moments have these."""


def seed_of(*parts: str | int) -> int:
    """One 32-bit seed from a shot's name, a frame, a pass; Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


@dataclass(frozen=True)
class Pass:
    """A few samples a pixel of one sub-frame.

    layer   "guides" or "beauty"
    marked  whether what vertices bring along is looked at with the same samples
    first   how many samples of light the picture has had before, all sub-frames together
    """

    subframe: int
    layer: str
    samples: int
    marked: bool = False
    first: int = 0


@dataclass
class Passes:
    """The passes of a picture, and the sums of what they found.

    count    how many sub-frames share its samples
    on_pass  is told after each pass how many are done, and of how many at most
    keep     where the sums are kept for another process to go on with, and taken from at first
    """

    quality: Quality
    count: int
    aovs: Collection[str]
    seed: int
    on_pass: Callable[[int, int], None] | None = None
    keep: Checkpoint | None = None
    _sums: dict[str, Picture] = field(default_factory=dict)
    _terms: dict[str, int] = field(default_factory=dict)
    _done: int = 0
    _taken: int = 0
    _batch: list[Picture] = field(default_factory=list)

    def __post_init__(self) -> None:
        if "noise" in self.aovs and self.quality.samples < 2:
            raise BadInputError("layer 'noise' cannot be told from one sample; take samples: 2 or more")
        self._guides = passes_of(self.quality.auxiliary_samples, self.count)
        adaptive = self.quality.noise_threshold is not None
        self._beauty = (turns_of if adaptive else passes_of)(self.quality.samples, self.count)
        self._order = self._in_order()
        shared = self.count if adaptive else self.count * len(self._beauty)
        self._together = batch_of(shared, self._beauty[0])
        if self.keep is not None and (sums := self.keep.load()) is not None:
            self._restore(sums)

    def left(self) -> Iterator[Pass]:
        """Those to be rendered, one after the other, until all are done or the picture is quiet enough."""
        while self._done < len(self._order) and not self._quiet_enough():
            yield self._order[self._done]

    def render(self, one: Pass, scenes: Scenes, marks: Mapping[str, NDArray[np.float32]]) -> None:
        """The next of those left. marks: by name (V, 3), what its layers show of the vertices"""
        if one.layer == "beauty":
            self._add_beauty(self._light(one, scenes.beauty))
        else:
            seed = seed_of(self.seed, self._done, one.layer)
            self._add("guides", scenes.guides.render(one.samples, seed))
            if one.marked and scenes.dyed is not None:
                self._add_marks(scenes.dyed, marks, one.samples, seed)
        self._done += 1
        if self.keep is not None:
            self.keep.offer(self._state)
        if self.on_pass is not None:
            self.on_pass(self._done, len(self._order))

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

    def facts(self) -> dict[str, float]:
        """The samples of light a pixel; of a picture that could end earlier those taken, and its noise."""
        if self.quality.noise_threshold is None:
            return {"samples": self.quality.samples}
        noise = {"noise": float(f"{self._noise:.4g}")} if self._comparable else {}
        return {"samples": self._taken, **noise}

    def _light(self, one: Pass, beauty: Rendering) -> Picture:
        """Our own paths go on in one sequence from pass to pass; Mitsuba's know nothing of each other."""
        if beauty.light is not None:
            self._taken += one.samples
            return np.asarray(beauty.light.picture(one.samples, one.first, seed_of(self.seed, one.layer)))
        self._taken += _rectangle(one.samples)
        found = beauty.render(one.samples, seed_of(self.seed, self._done, one.layer))
        return found[..., _OF_MOMENTS] if "noise" in self.aovs else found

    def _in_order(self) -> list[Pass]:
        """Sub-frame by sub-frame; where passes may end early, one pass of light of each in turn, so that all
        have been given the same then."""
        marked = [index == 0 for index in range(len(self._guides))]  # what goes along with points is smooth
        guides = [
            [Pass(i, "guides", n, first) for n, first in zip(self._guides, marked, strict=True)]
            for i in range(self.count)
        ]
        beauty = [[Pass(i, "beauty", n) for n in self._beauty] for i in range(self.count)]
        if self.quality.noise_threshold is None:
            return _counted([one for i in range(self.count) for one in (*guides[i], *beauty[i])])
        first = [one for i in range(self.count) for one in (*guides[i], beauty[i][0])]
        return _counted(first + [one for turn in zip(*beauty, strict=True) for one in turn][self.count :])

    def _quiet_enough(self) -> bool:
        threshold = self.quality.noise_threshold
        amid_turn = "turn" in self._sums or self._batch
        return threshold is not None and not amid_turn and self._comparable and self._noise <= threshold

    @property
    def _comparable(self) -> bool:
        return self._terms.get("squares", 0) >= FEWEST_PASSES

    @property
    def _noise(self) -> float:
        return noise_of(self._sums["luminances"], self._sums["squares"], self._terms["squares"])

    def _state(self) -> dict[str, NDArray[Any]]:
        """All that passes have found, exactly."""
        sums = {f"sum:{name}": total for name, total in self._sums.items()}
        terms = {f"terms:{name}": np.array(count) for name, count in self._terms.items()}
        batch = {f"batch:{index}": picture for index, picture in enumerate(self._batch)}
        done, taken = np.array(self._done), np.array(self._taken)
        return {"done": done, "taken": taken, **sums, **terms, **batch}

    def _restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `_state` gave."""

        def named(kind: str) -> dict[str, NDArray[Any]]:
            return {key.removeprefix(kind): state[key] for key in state if key.startswith(kind)}

        self._done, self._taken = int(state["done"]), int(state["taken"])
        self._sums = named("sum:")
        self._terms = {name: int(count) for name, count in named("terms:").items()}
        self._batch = list(named("batch:").values())

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
            light = without_sparkles(np.asarray(whole))
            self._add("beauty", light)
            self._batch = []
            if self.quality.noise_threshold is not None:
                self._compare(light @ _LUMA)

    def _compare(self, luminance: Picture) -> None:
        """Once all sub-frames have been given their light of one turn, their mean is what is compared."""
        self._add("turn", luminance)
        if self._terms["turn"] * self._together == self.count:
            whole = self._sums.pop("turn") / self._terms.pop("turn")
            self._add("luminances", whole)
            self._add("squares", whole * whole)

    def _add_marks(
        self, dyed: Rendering, marks: Mapping[str, NDArray[np.float32]], samples: int, seed: int
    ) -> None:
        """The same samples as the guides have, so that what covers a pixel there covers it here."""

        def look(values: NDArray[np.float32]) -> Picture:
            dyed.set("subject", DYE, values)
            return dyed.render(samples, seed)[..., :3]

        for name, picture in looked_at(marks, look).items():
            self._add(name, picture)


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

    They lie more evenly, and the moments of a shutter too, so the error is rather less.
    """
    variance = np.maximum(square - mean * mean, 0.0) * samples / (samples - 1)
    return np.asarray(np.sqrt(variance / samples), dtype=np.float64)


def _counted(passes: list[Pass]) -> list[Pass]:
    """The same, told how many samples of light there were before each."""
    light = [one.samples if one.layer == "beauty" else 0 for one in passes]
    before = accumulate(light, initial=0)
    return [replace(one, first=first) for one, first in zip(passes, before, strict=False)]


def _rectangle(samples: int) -> int:
    """How many samples multijitter takes that is asked for so many."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)
