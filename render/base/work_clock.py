"""Wall time, CPU seconds and memory of work.

Under load the two differ: other programs have the cores while a process waits for them. CPU seconds hardly
change, so they say what work costs.
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

CONTROL_GROUPS = Path("/sys/fs/cgroup")


def cpu_seconds() -> float:
    """Return the CPU seconds, user and system, of this process and of its children that have ended."""
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system


def peak_memory() -> int:
    """Return the most memory that this process has held, in MiB."""
    try:
        import resource
    except ImportError:  # Windows, where psutil knows it
        import psutil

        return int(psutil.Process().memory_info().peak_wset) >> 20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) >> (20 if sys.platform == "darwin" else 10)  # which counts bytes, others KiB


def free_memory() -> float:
    """Return the memory that this process may still take, in MB: of the machine or, where it has less, of the
    control group in which a container or a farm's scheduler has put it."""
    import psutil  # which most processes never need

    free = float(psutil.virtual_memory().available)
    with suppress(OSError, ValueError):  # not Linux, or groups of version 1
        name = Path("/proc/self/cgroup").read_text("utf-8").rpartition("::/")[2].partition("\n")[0]
        group = CONTROL_GROUPS / name
        for folder in (group, *group.parents):
            if (most := folder / "memory.max").exists() and (
                limit := most.read_text("utf-8").strip()
            ).isdecimal():
                free = min(free, float(limit) - float((folder / "memory.current").read_text("utf-8")))
    return free / 1e6


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
