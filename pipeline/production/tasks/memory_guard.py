"""When a rendering process is replaced by a fresh one: once it has grown.

Renderers are long-lived C++; what they lose from frame to frame only the end of their process gives back.
No process renders more than `plan.BATCH` frames; one that has grown ends before.
"""

from __future__ import annotations

import gc
import math
import os
from dataclasses import dataclass, field

import psutil

from pipeline.errors import UsageError

RENEWED = 75
"""The exit code of a rendering process that wants a fresh one to render the rest of its frames."""

GROWTH = 1.5
"""How many times the memory after its first frame a process may hold."""

LEAST_MIB = 1024
"""What a process may hold in any case."""

VARIABLE = "FLOWSCULPT_WORKER_MIB"
"""The environment variable that says instead how much a process may hold, in MiB."""


class WornOutError(Exception):
    """This process holds too much (MiB, and how much it may) and is to be replaced before its next frame."""

    def __init__(self, held: float, most: float | None) -> None:
        super().__init__(held, most)
        self.held, self.most = held, most


@dataclass
class Wear:
    """How much this process has grown while it renders. Raises UsageError where VARIABLE says no size."""

    _most: float | None = field(default_factory=lambda: _said())
    _worn: float | None = None

    def rendered(self) -> None:
        """A frame was made."""
        held = _resident_mib()
        if self._most is None:
            self._most = max(float(LEAST_MIB), GROWTH * held)
        if held > self._most:
            gc.collect()
            held = _resident_mib()
        self._worn = held if held > self._most else None

    def heed(self) -> None:
        """Raises WornOutError, with how much is held, where it was too much after the last frame."""
        if self._worn is not None:
            raise WornOutError(self._worn, self._most)


def _resident_mib() -> float:
    return float(psutil.Process().memory_info().rss) / 2**20


def _said() -> float | None:
    """What the environment allows, if it says so."""
    said = os.environ.get(VARIABLE)
    if not said:
        return None
    try:
        most = float(said)
    except ValueError:
        most = math.nan
    if not (math.isfinite(most) and most > 0.0):
        raise UsageError(f"{VARIABLE} is {said!r}; it must be a size in MiB, such as 4096")
    return most
