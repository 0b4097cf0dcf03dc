"""Processes of tests: wait for what they do, and start one that has the number of one that has ended."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

LAST_NUMBER = Path("/proc/sys/kernel/ns_last_pid")

HEARS_HANGUPS = pytest.mark.skipif(
    signal.getsignal(signal.SIGHUP) is signal.SIG_IGN, reason="nohup has hangups ignored"
)


def wait_until(is_true: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until a condition holds. The limit only ends a test that hangs."""
    limit = time.monotonic() + seconds
    while not is_true():
        assert time.monotonic() < limit, "waited in vain"
        time.sleep(0.01)


def has_ended(process: psutil.Process) -> bool:
    """Tell whether a process has ended, also where nobody has asked for its exit code yet."""
    try:
        return bool(process.status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


@contextmanager
def process_numbered(number: int) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process that sleeps under a number that is free; skip the test where the system lets nobody."""
    time.sleep(0.05)  # the system tells starts of processes apart by hundredths of a second
    for _ in range(200):  # others take numbers too
        try:
            LAST_NUMBER.write_text(str(number - 1))
        except OSError:
            pytest.skip("the numbers of processes cannot be chosen here")
        process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
        try:
            if process.pid == number:
                yield process
                return
        finally:
            process.kill()
            process.wait()
    pytest.fail(f"the number {number} is never free")
