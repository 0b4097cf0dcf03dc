"""Wall time and CPU seconds of work.

Under load the two differ: other programs have the cores while a process waits for them. CPU seconds hardly
change, so they say what work costs.
"""

from __future__ import annotations

import resource
import time
from typing import NamedTuple


def cpu_seconds() -> float:
    """Return the CPU seconds, user and system, of this process and of its children that have ended."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


class Timing(NamedTuple):
    """The time that a piece of work took.

    seconds  wall time
    cpu      CPU seconds of all threads of the process, and of its children that have ended
    """

    seconds: float
    cpu: float


class WorkClock:
    """Times the work of this process, piece by piece."""

    def __init__(self) -> None:
        self._last = Timing(time.perf_counter(), cpu_seconds())

    def lap(self) -> Timing:
        """Return the time since the last call, or since the clock was made."""
        before, self._last = self._last, Timing(time.perf_counter(), cpu_seconds())
        return Timing(self._last.seconds - before.seconds, self._last.cpu - before.cpu)
