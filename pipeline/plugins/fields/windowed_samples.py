"""Samples in files, of which only the times around a moment are in memory."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar

import numpy as np

from flowsculpt import FrameError, MissingInputError
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.flows import Samples, StableProperty
from flowsculpt.api.meshes import Floats, ModelFile
from flowsculpt.pipeline.plugins.fields.chunked_times import TimeChunks, small_pages
from flowsculpt.pipeline.plugins.fields.grid_layout import Box
from flowsculpt.pipeline.plugins.fields.scratch_arrays import ScratchArrays

VERSION = 2
"""Raised when equal files and settings give other velocities."""

KEPT, KEPT_BYTES = 2, 1 << 28
"""Times whose velocities are kept in memory at least, and the bytes up to which more are."""

ONCE_EACH = 2
"""Times are read for their gradients and for their frames; from the next time on they are kept in a file."""

ONCE_EACH_CHUNK = 1  # jobs, to whom planning has told the gradients, read the chunks of their frames alone

MAX_SPEED = 1e12  # as of any number in a shot file: squares and sums of such numbers stay finite

ROWS = 16  # nodes along an axis that are checked at once

SourceFiles = tuple[tuple[Path, str], ...]
"""Files and their digests; empty for a file that is not there."""


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, which is read again only once its size, time or place has changed."""
    return ModelFile(path).files(keeps_digest=True).files[0][1]


class WindowedSamples(Samples, ABC):
    """Samples in files: read when they are used, and checked against the digests that keys have.

    Classes of them are frozen dataclasses; equal samples read the same. What others have of attributes of
    `Samples` they define themselves.
    """

    array: ClassVar[str | None] = None  # type: ignore[misc]
    is_single: ClassVar[bool] = True  # type: ignore[misc]

    @property
    @abstractmethod
    def settings(self) -> Any:
        """Everything besides the contents of files that decides the velocities, JSON-able."""

    @abstractmethod
    def current_files(self, index: int, has_velocities: bool = True) -> SourceFiles:
        """Return the files of a time and their digests, for which nothing is parsed.

        has_velocities  False leaves out chunks of velocities, where these are files
        """

    @abstractmethod
    def place(self, index: int) -> Any:
        """Return where the time is in its files, JSON-able."""

    @abstractmethod
    def read(self, index: int) -> np.ndarray:
        """Return float32 velocities (X, Y, Z, 3) at a time, in C order."""

    parts: tuple[list[slice], ...] | None = None
    """Along each axis the nodes of the chunks that are read one by one; None where times are read whole."""

    def read_chunk(self, index: int, out: np.ndarray, box: Box) -> SourceFiles:
        """Write the velocities of a chunk to those of its time; return its files and their digests.

        box  its nodes
        """
        raise NotImplementedError

    def metric(self, axis: int) -> Floats:
        """Return the distances between neighbours along an axis, to be broadcast to theirs (X, Y, Z)."""
        return np.diff(self.axes[axis]).reshape([-1 if k == axis else 1 for k in range(3)])

    @property
    def is_large(self) -> bool:  # type: ignore[override]
        return len(self.times) > self._room

    @property
    def _room(self) -> int:
        """The times whose velocities are kept in memory."""
        return max(KEPT, KEPT_BYTES // (12 * math.prod(map(len, self.axes))))

    def __getstate__(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]

    def files(self, index: int) -> SourceFiles:
        """Return the files of a time as they were at first: keys have these digests."""
        if index not in self._files:
            self._files[index] = self.current_files(index)
        return self._files[index]

    @cached_property
    def _files(self) -> dict[int, SourceFiles]:
        return {}

    def digest(self, index: int) -> str:
        if index not in self._digests:
            contents = [digest for _, digest in self.files(index)]
            deciding = [VERSION, self.settings, self.place(index), contents]
            self._digests[index] = hashlib.sha256(json.dumps(deciding).encode()).hexdigest()
        return self._digests[index]

    @cached_property
    def _digests(self) -> dict[int, str]:
        return {}

    def velocities(self, index: int) -> np.ndarray:
        return self.chunks(index).whole()

    def chunks(self, index: int) -> TimeChunks:
        """Return a time, of which those chunks are there that were needed; without `parts` all."""
        with self._lock:
            if index in self._kept:
                return self._kept[index]
            while len(self._kept) >= self._room:  # before others take as much memory
                del self._kept[max(self._kept, key=lambda each: abs(each - index))]  # its neighbour stays
            kept = self._scratch.get(index)
            if kept is None:
                self._reads[index] += 1
                velocity = self._read(index)
                if self._reads[index] > (ONCE_EACH if self.parts is None else ONCE_EACH_CHUNK):
                    kept = self._scratch.add(index, velocity, self.parts is None)
            self._kept[index] = self._in_chunks(index, velocity if kept is None else kept, kept is not None)
            return self._kept[index]

    def _in_chunks(self, index: int, velocity: np.ndarray, is_scratch: bool) -> TimeChunks:
        """Return a time as its chunks; in the temporary file those that were read are still there."""
        if self.parts is None:
            return TimeChunks(velocity)
        known, is_read = dict(self.files(index)), self._in_scratch.get(index) if is_scratch else None

        def read(out: np.ndarray, box: Box) -> None:
            self._require_known(self.read_chunk(index, out, box), known)
            self._require_finite(next(iter(known)), out[box], index)

        chunks = TimeChunks(velocity, self.parts, read, is_read)
        if is_scratch:
            self._in_scratch[index] = chunks.is_read
        return chunks

    @cached_property
    def _in_scratch(self) -> dict[int, Floats]:
        """Which chunks of a time are in the temporary file, as `TimeChunks.is_read`."""
        return {}

    @cached_property
    def _kept(self) -> dict[int, TimeChunks]:
        return {}

    @cached_property
    def _reads(self) -> Counter[int]:
        """How often each time was read."""
        return Counter()

    @cached_property
    def _scratch(self) -> ScratchArrays:
        """Times that are needed again and again, as where vertices are born on surfaces from seeds."""
        return ScratchArrays((*map(len, self.axes), 3))

    @StableProperty
    def _lock(self) -> Lock:
        return Lock()

    def _read(self, index: int) -> np.ndarray:
        """Return the velocities of a time, which with `parts` are 0 and not read yet."""
        known = self.files(index)
        if self.parts is not None:
            self._require_known(self.current_files(index, has_velocities=False), dict(known))
            return small_pages((*map(len, self.axes), 3))
        velocity = self.read(index)
        self._require_known(self.current_files(index), dict(known))
        self._require_finite(known[0][0], velocity, index)
        return velocity

    @staticmethod
    def _require_known(now: SourceFiles, known: dict[Path, str]) -> None:
        for path, digest in now:
            if known.get(path) != digest:
                raise MissingInputError(f"{path}: it was changed since the work was planned; run again")

    def _require_finite(self, path: Path, velocity: np.ndarray, index: int) -> None:
        """Raise FrameError where a velocity is not a finite number of a reasonable size."""
        for first in range(0, len(velocity), ROWS):
            part = velocity[first : first + ROWS]
            if not (part.max() <= MAX_SPEED and part.min() >= -MAX_SPEED):  # so neither if it has a NaN
                bad = np.unravel_index(int(np.argmin(np.abs(part) <= MAX_SPEED)), part.shape)
                raise FrameError(
                    f"{path}: time {index + 1} of {len(self.times)}: a velocity is {part[bad]:g}; samples "
                    "must be finite, and at most 1e12. Name the fill value of the variable in its _FillValue."
                )

    def slopes(self, index: int) -> Floats:
        """Return the largest secants, kept in the user's cache: planning then reads no velocities."""
        answer = CachedAnswer.of("field_slopes", [self.digest(index)])
        known = answer.load(lambda kept: [float(number) for number in kept["slopes"]])
        if known is None or len(known) != 3:
            velocity = self.velocities(index)
            known = [_largest_secant(velocity, self.metric(k), k) for k in range(3)]
            answer.store_alone({"slopes": known})
        return np.array(known)


def _largest_secant(velocity: np.ndarray, metric: Floats, k: int) -> float:
    """Return the largest difference of neighbours along axis k over their distance."""
    most = 0.0
    for first in range(0, len(velocity), ROWS):
        rises = np.diff(velocity[first : first + ROWS + (k == 0)], axis=k)
        rises *= rises
        squares = rises[..., 0] + rises[..., 1] + rises[..., 2]
        along = metric[first : first + ROWS] if len(metric) > 1 else metric
        alike = tuple(
            axis for axis in range(3) if along.shape[axis] == 1
        )  # of one distance the largest is enough
        longest = np.sqrt(squares.max(axis=alike, keepdims=True, initial=0.0))
        most = max(most, float((longest / along).max(initial=0.0)))
    return most
