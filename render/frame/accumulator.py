"""Sums of sample batches and what follows from them: AOVs, noise, whether the frame has converged; and their
checkpoints, from which another process resumes.
"""

from __future__ import annotations

import contextlib
import time
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.atomic_write import atomic_write
from render.base.errors import BadInputError, MachineError
from render.scene.aovs import Pixels
from render.scene.quality import Quality

Picture = NDArray[np.float64]

FIREFLY_FACTOR = 3.0
"""Most brightness of a pixel in one batch, over the third brightest of its eight neighbours."""

LUMINANCE, SQUARE = 3, 4
"""Channels of a beauty picture: mean luminance, and mean of its square."""

MIN_BATCHES = 2
"""Batches needed to compare."""

NOISE_BLOCK = 16
"""Pixels along the side of a block."""

QUIET_FRACTION = 0.95
"""Fraction of the blocks that must be below the threshold, so that the noisiest corner does not decide."""

MIN_LUMINANCE = 0.01
"""Luminance below which noise counts as if the light were this bright."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])

SECONDS = 10.0
"""Least time between two checkpoints: a frame that takes less has none and pays nothing."""

MIN_WORK = 50.0
"""Least rendering time between two checkpoints, over the time that writing one took: they cost 2%."""


@dataclass
class Accumulator:
    """The sums of the sample batches of one frame, in the order in which they are added.

    quality         of the frame
    aovs            names of AOVs beyond those of all frames
    combined        beauty batches that are averaged before fireflies are removed
    motion_samples  their number
    samples         samples per pixel of the beauty so far
    """

    quality: Quality
    aovs: Collection[str]
    combined: int
    motion_samples: int
    samples: int = 0
    _sums: dict[str, Picture] = field(default_factory=dict)
    _terms: dict[str, int] = field(default_factory=dict)
    _waiting: list[Picture] = field(default_factory=list)

    def __post_init__(self) -> None:
        if "noise" in self.aovs and self.quality.samples < 2:
            raise BadInputError("AOV 'noise' needs 2 samples or more; the quality has 1")

    def add(self, name: str, picture: Picture) -> None:
        """Add a batch of an AOV, or of "auxiliary" (see `mitsuba.scene.FrameScenes`)."""
        self._sums[name] = self._sums[name] + picture if name in self._sums else picture
        self._terms[name] = self._terms.get(name, 0) + 1

    def add_beauty(self, picture: Picture, samples: int) -> None:
        """Add a batch of the beauty, with channels LUMINANCE and SQUARE if the AOV `noise` is wanted."""
        self.samples += samples
        self._waiting.append(picture[..., :3])
        if "noise" in self.aovs:
            self.add("luminance", picture[..., LUMINANCE])
            self.add("square", picture[..., SQUARE])
        if len(self._waiting) == self.combined:
            mean = self._waiting[0] if self.combined == 1 else sum(self._waiting) / self.combined
            light = without_fireflies(np.asarray(mean))
            self.add("beauty", light)
            self._waiting = []
            if self.quality.noise_threshold is not None:
                self._compare(light @ _LUMA)

    def frame_aovs(self) -> dict[str, Pixels]:
        """Return the AOVs by name, once all motion samples have been rendered."""
        means = {name: total / self._terms[name] for name, total in self._sums.items()}
        auxiliary = means["auxiliary"]
        arrays = {
            "beauty": means["beauty"],
            "albedo": np.clip(auxiliary[..., 0:3], 0.0, 1.0),
            "normal": auxiliary[..., 7:10],
            "position": auxiliary[..., 4:7],
            "depth": auxiliary[..., 3],
            "matte": np.clip(auxiliary[..., 11], 0.0, 1.0),
        }
        for name in self.aovs:
            if name == "noise":
                arrays[name] = _standard_error(means["luminance"], means["square"], self.samples)
            elif name == "samples":
                arrays[name] = np.full(auxiliary.shape[:2], self.samples)
            else:
                arrays[name] = means[name][..., :2] if name == "motion" else means[name]
        return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}

    def facts(self) -> dict[str, float]:
        """Return the samples per pixel and, with adaptive sampling, the noise."""
        if self.quality.noise_threshold is None:
            return {"samples": self.quality.samples}
        noise = {"noise": float(f"{self._noise:.4g}")} if self._is_comparable else {}
        return {"samples": self.samples, **noise}

    @property
    def has_converged(self) -> bool:
        """True if the noise is at most the quality's threshold, between rounds of motion samples."""
        threshold = self.quality.noise_threshold
        amid_round = "round" in self._sums or self._waiting
        return threshold is not None and not amid_round and self._is_comparable and self._noise <= threshold

    @property
    def _is_comparable(self) -> bool:
        return self._terms.get("squares", 0) >= MIN_BATCHES

    @property
    def _noise(self) -> float:
        return noise_of(self._sums["luminances"], self._sums["squares"], self._terms["squares"])

    def _compare(self, luminance: Picture) -> None:
        """Add the luminance of a batch. The mean over a round of all motion samples is what is compared."""
        self.add("round", luminance)
        if self._terms["round"] * self.combined == self.motion_samples:
            mean = self._sums.pop("round") / self._terms.pop("round")
            self.add("luminances", mean)
            self.add("squares", mean * mean)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything, for a checkpoint."""
        sums = {f"sum:{name}": total for name, total in self._sums.items()}
        terms = {f"terms:{name}": np.array(count) for name, count in self._terms.items()}
        waiting = {f"waiting:{index}": picture for index, picture in enumerate(self._waiting)}
        return {"samples": np.array(self.samples), **sums, **terms, **waiting}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned."""

        def named(kind: str) -> dict[str, NDArray[Any]]:
            return {key.removeprefix(kind): state[key] for key in state if key.startswith(kind)}

        self.samples = int(state["samples"])
        self._sums = named("sum:")
        self._terms = {name: int(count) for name, count in named("terms:").items()}
        self._waiting = list(named("waiting:").values())


def without_fireflies(light: Picture) -> Picture:
    """Return radiance (H, W, 3) of one batch with single bright pixels dimmed to the bound of FIREFLY_FACTOR.

    A highlight or a thin bright line has at least three bright neighbours at every pixel and stays; a path
    that hit an emitter by chance has none.
    """
    luminance = light @ _LUMA
    height, width = luminance.shape
    padded = np.pad(luminance, 1, mode="edge")
    offsets = [(y, x) for y in range(3) for x in range(3) if (y, x) != (1, 1)]
    neighbours = [padded[y : y + height, x : x + width] for y, x in offsets]
    third = np.partition(np.stack(neighbours), 5, axis=0)[5]
    bound = FIREFLY_FACTOR * third + 1e-3
    return np.asarray(light * (bound / np.maximum(luminance, bound))[..., None], dtype=np.float64)


def _standard_error(mean: Picture, square: Picture, samples: int) -> Picture:
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


@dataclass
class Checkpoint:
    """The checkpoint of one frame: a file, written atomically, with the sums as added, in float64.

    A resumed frame is the same to the last bit as one that was never interrupted.

    path     the file; its name must say everything that decides the picture
    draft    temporary file on the same file system
    warn     is called with a message, once per fault; a frame never fails by its checkpoint
    urgent   tells whether the process is about to end
    seconds  least time between two checkpoints
    resumed  sample batches that `load` has read
    """

    path: Path
    draft: Path
    warn: Callable[[str], None] = field(default=lambda message: None)
    urgent: Callable[[], bool] = field(default=lambda: False)
    seconds: float = SECONDS
    resumed: int = field(default=0, init=False)
    _due: float = field(default=0.0, init=False)
    _refused: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    def load(self) -> dict[str, NDArray[Any]] | None:
        """Return the stored state, of which `done` is the number of batches, or None.

        A damaged file is reported by `warn` and removed.
        """
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                state = {name: arrays[name] for name in arrays.files}
            self.resumed = int(state["done"])
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, zipfile.BadZipFile, ValueError, KeyError, EOFError, AttributeError) as error:
            self.warn(f"{self.path} cannot be read ({error}); its picture is rendered from the start")
            self.remove()
            return None
        return state

    def save_if_due(self, state: Callable[[], Mapping[str, NDArray[Any]]]) -> None:
        """Write a checkpoint if one is due. `state` is called only then."""
        now = time.monotonic()
        if self._refused or not (self.urgent() or now >= self._due):
            return
        try:
            with atomic_write(self.path, self.draft, flush=False) as draft, draft.open("wb") as file:
                np.savez(file, allow_pickle=False, **state())  # a path would be given another suffix
        except MachineError as error:
            self._refused = True
            self.warn(f"{error}; if interrupted, its picture starts anew")
        spent = time.monotonic() - now
        self._due = now + spent + max(self.seconds, MIN_WORK * spent)

    def remove(self) -> None:
        """Remove the file. One that cannot be removed is left to the next run."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
