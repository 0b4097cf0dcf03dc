"""What a job asks for, of a farm or of this machine: memory and time, by what earlier pictures took."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

UNMEASURED_MIB = 4096
"""Memory for a job of which nothing is known: five times what a film frame of 4 million faces takes."""

LEAST_MIB = 1024
"""Memory that any job is given: its Python, its libraries, and Snakemake's two processes beside it."""

SPARE = 1.5
"""How many times the most memory measured a job is given."""

PATIENCE = 4.0
"""How many times the measured seconds a job may take; nodes differ, and so do frames."""

START_MINUTES = 10
"""What is added for beginning: compiled kernels, a renderer's first frame, a busy disk."""


@dataclass(frozen=True)
class Needs:
    """Memory in MiB, and time in minutes, None where it is not known; each attempt asks for as much again."""

    mib: int = UNMEASURED_MIB
    minutes: int | None = None


UNMEASURED = Needs()

HERE = Needs(LEAST_MIB)
"""Of such a job on this machine, where more is tried at once, and fewer once something was killed."""


@dataclass(frozen=True)
class Experience:
    """What earlier pictures took: the most memory (MiB), and the most seconds of one core."""

    mib: float
    seconds: float

    @classmethod
    def of(cls, folder: Path) -> Experience | None:
        """That of the pictures whose statistics lie in a folder; None where there are none yet."""
        told = [statistics for path in sorted(folder.glob("*.json")) if (statistics := _read(path))]
        if not told:
            return None
        return cls(max(mib for mib, _ in told), max(seconds for _, seconds in told))

    def needs(self, frames: int, threads: int) -> Needs:
        """Those of a job that renders so many frames on so many cores."""
        seconds = PATIENCE * frames * self.seconds / threads
        mib = max(LEAST_MIB, SPARE * self.mib + LEAST_MIB / 2)
        return Needs(math.ceil(mib), START_MINUTES + math.ceil(seconds / 60.0))


def _read(path: Path) -> tuple[float, float] | None:
    """Memory and core seconds of one picture; what cannot be read tells nothing."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        told = json.loads(path.read_text())
        return float(told["peak_memory_mib"]), sum(told["seconds"].values()) * int(told["threads"])
    return None
