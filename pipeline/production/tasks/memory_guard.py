"""Replace a rendering process by a fresh one once it has grown.

Renderers are long-lived C++; memory that they lose from frame to frame comes back only when their process
ends. No process renders more than `plan.BATCH` frames; one that has grown ends before.
"""

from __future__ import annotations

import gc
import math
import os
from dataclasses import dataclass, field

import psutil

from pipeline.errors import UsageError

RESTART_WORKER = 75
"""The exit code of a rendering process that wants a fresh one to render the rest of its frames."""

GROWTH = 1.5
"""Limit on the memory of a process, as a multiple of what it holds after its first frame."""

LEAST_MIB = 1024
"""Memory that a process may hold in any case."""

VARIABLE = "FLOWSCULPT_WORKER_MIB"
"""The environment variable that sets the memory limit of a process, in MiB."""


class RestartWorker(Exception):  # noqa: N818 - a request, not an error
    """Raised when resident memory exceeds the limit; the supervisor starts a new worker.

    held, limit  MiB
    """

    def __init__(self, held: float, limit: float | None) -> None:
        super().__init__(held, limit)
        self.held, self.limit = held, limit


@dataclass
class MemoryGuard:
    """Watches the memory of this process. Raises UsageError where VARIABLE is no size."""

    _limit: float | None = field(default_factory=lambda: _limit_from_environment())
    _excess: float | None = None

    def measure(self) -> None:
        """Measure what this process holds after a frame; the first one sets the limit."""
        held = _resident_mib()
        if self._limit is None:
            self._limit = max(float(LEAST_MIB), GROWTH * held)
        if held > self._limit:
            gc.collect()
            held = _resident_mib()
        self._excess = held if held > self._limit else None

    def check(self) -> None:
        """Raise RestartWorker if the last measurement exceeded the limit."""
        if self._excess is not None:
            raise RestartWorker(self._excess, self._limit)


def _resident_mib() -> float:
    return float(psutil.Process().memory_info().rss) / 2**20


def _limit_from_environment() -> float | None:
    text = os.environ.get(VARIABLE)
    if not text:
        return None
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not (math.isfinite(limit) and limit > 0.0):
        raise UsageError(f"{VARIABLE} is {text!r}; it must be a size in MiB, such as 4096")
    return limit
