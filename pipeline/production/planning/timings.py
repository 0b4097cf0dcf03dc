"""Time and memory that frames took, and what jobs therefore request of a farm or of this machine.

Renders request what earlier frames of their shot and quality took. Other jobs, and renders before there are
any, request defaults.

A render writes statistics with each picture, and every job appends to the event log of its run. Both are
left out where they are missing or damaged: they inform, and decide no result.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.render.base.state_files import read_state

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.pipeline.production.store.store import Key


SHARED_STAGES = frozenset(name for name, stage in STAGES.items() if not stage.per_quality)
"""Stages whose files all qualities share, and which take as long at each."""


@dataclass(frozen=True)
class RenderStatistics:
    """Time and memory that the render of one picture took.

    key              key of the raw picture
    seconds          wall time by part of the work, such as `rendering`
    threads          cores that it used
    peak_memory_mib  of its process
    resumed_batches  sample batches from an earlier process, whose seconds are not known
    pixels           of the picture; 0 where it is not known
    cpu_seconds      by part; empty in statistics of earlier versions
    """

    key: Key
    seconds: Mapping[str, float]
    threads: int
    peak_memory_mib: float
    resumed_batches: int = 0
    pixels: int = 0
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)

    def growth(self, pixels: int) -> float:
        """Return the factor, at least 1, by which a picture of so many pixels is larger; 1 if not known."""
        return max(1.0, pixels / self.pixels) if self.pixels else 1.0

    @property
    def cost(self) -> Mapping[str, float]:
        """Core-seconds by part: CPU seconds or, where they were not counted, wall time on all threads."""
        return self.cpu_seconds or {part: taken * self.threads for part, taken in self.seconds.items()}

    @property
    def held_core_seconds(self) -> float:
        """The core-seconds for which the render held its threads, with those in which they waited."""
        return sum(self.seconds.values()) * self.threads


def read_statistics(path: Path) -> RenderStatistics | None:
    """Read the statistics of one picture; None where they are missing or damaged."""
    return read_state(
        path,
        lambda data: RenderStatistics(
            key=str(data["key"]),
            seconds={str(part): float(seconds) for part, seconds in data["seconds"].items()},
            threads=int(data["threads"]),
            peak_memory_mib=float(data["peak_memory_mib"]),
            resumed_batches=int(data.get("resumed_batches", 0)),
            pixels=int(data.get("pixels", 0)),
            cpu_seconds={str(part): float(cpu) for part, cpu in data.get("cpu_seconds", {}).items()},
        ),
    )


def statistics_in(folder: Path) -> Iterator[RenderStatistics]:
    """Yield the readable statistics of a folder."""
    for path in folder.glob("*.json"):
        if (statistics := read_statistics(path)) is not None:
            yield statistics


UNMEASURED_MIB = 4096
"""Memory of a job on a farm while nothing is measured: five times that of a film frame of 4 million faces."""

LEAST_MIB = 1024
"""Memory of any job: its Python, its libraries, and Snakemake's two processes beside it."""

_MEMORY_MARGIN = 1.5
"""Factor on the largest memory measured."""

_TIME_MARGIN = 4.0
"""Factor on the longest time measured: nodes differ, and so do frames."""

START_MINUTES = 10
"""Time to begin: compiled kernels, a renderer's first frame, a busy disk."""

UNMEASURED_MINUTES = 240
"""Time limit of a farm's job without measurements; `set-resources` of a profile sets another."""


@dataclass(frozen=True)
class MeasuredResources:
    """The most that earlier renders of a shot at a quality took, more for pictures that were smaller.

    mib      memory of a process, MiB
    seconds  core-seconds of one picture, by wall time: a limit must not end a job that waits
    """

    mib: float
    seconds: float

    @classmethod
    def of(cls, folder: Path, pixels: int) -> MeasuredResources | None:
        """Read the statistics of a folder, for pictures of so many pixels; None while there are none."""
        renders = list(statistics_in(folder))
        if not renders:
            return None
        mib = max(r.peak_memory_mib * r.growth(pixels) for r in renders)
        return cls(mib, max(r.held_core_seconds * r.growth(pixels) for r in renders))

    @property
    def memory_mib(self) -> int:
        """The memory that a render job requests, MiB."""
        return math.ceil(max(LEAST_MIB, _MEMORY_MARGIN * self.mib + LEAST_MIB / 2))

    def minutes(self, frames: int, threads: int) -> int:
        """Return the time limit of a job that renders so many frames on so many threads."""
        return START_MINUTES + math.ceil(_TIME_MARGIN * frames * self.seconds / threads / 60.0)


def measure_renders(
    root: Path, requests: Sequence[RenderRequest], places: Iterable[int] | None = None
) -> dict[int, MeasuredResources]:
    """Return what earlier renders of requests took, by their places, where any were measured under `root`.

    places  of the requests to look at, by default all
    """
    known = {}
    for place in range(len(requests)) if places is None else sorted(places):
        folder = root / requests[place].place("statistics", 0).parent
        width, height = requests[place].pictures.quality.rendered_size
        if (resources := MeasuredResources.of(folder, width * height)) is not None:
            known[place] = resources
    return known
