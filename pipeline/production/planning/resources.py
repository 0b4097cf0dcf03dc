"""Memory and time that a job requests of a farm or of this machine, from what earlier renders took."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from pipeline.production.planning.timings import statistics_in

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


@dataclass(frozen=True)
class MeasuredResources:
    """The most that earlier renders of a shot at a quality took.

    mib      memory of a process, MiB
    seconds  core-seconds of one picture
    """

    mib: float
    seconds: float

    @classmethod
    def of(cls, folder: Path) -> MeasuredResources | None:
        """Read the statistics of a folder; None while there are none."""
        renders = list(statistics_in(folder))
        if not renders:
            return None
        return cls(max(r.peak_memory_mib for r in renders), max(r.core_seconds for r in renders))

    @property
    def memory_mib(self) -> int:
        """The memory that a render job requests, MiB."""
        return math.ceil(max(LEAST_MIB, _MEMORY_MARGIN * self.mib + LEAST_MIB / 2))

    def minutes(self, frames: int, threads: int) -> int:
        """Return the time limit of a job that renders so many frames on so many threads."""
        return START_MINUTES + math.ceil(_TIME_MARGIN * frames * self.seconds / threads / 60.0)
