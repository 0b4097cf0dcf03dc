"""Processes of this host, known by number and start time: systems reuse the numbers of ended processes."""

from __future__ import annotations

import os
from contextlib import suppress


def start_of(process: int) -> float | None:
    """Return when a process started, in seconds after this host; None where it has ended, or is a zombie."""
    import psutil  # which most processes never need

    with suppress(psutil.Error, ValueError):
        found = psutil.Process(process)
        if found.status() != psutil.STATUS_ZOMBIE:
            return round(found.create_time() - psutil.boot_time(), 2)  # setting the clock moves both alike
    return None


def is_at_work(process: int, start: float | None = None) -> bool:
    """Tell whether a process still runs.

    start  as `start_of` had it, if known: then another process of its number does not count
    """
    try:
        if os.name == "posix":  # elsewhere 0 is a signal too
            os.kill(process, 0)
    except PermissionError:  # of another user, whose processes may be hidden
        return start is None or start_of(process) in (start, None)
    except (OSError, OverflowError):
        return False
    now = start_of(process)
    return now is not None and start in (now, None)


def command_of(process: int) -> list[str]:
    """Return the words of the command line of a process; none where it is gone."""
    import psutil

    with suppress(psutil.Error, ValueError):
        return list(psutil.Process(process).cmdline())
    return []
