"""What a run starts ends with it."""

import subprocess
import sys

import psutil

from pipeline.production.scheduler import end_family

PARENT = (
    "import subprocess, sys; c = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=subprocess.PIPE)"
)


def test_a_process_ends_with_all_that_it_started() -> None:
    code = f"{PARENT}; print(c.pid, flush=True); c.wait()"
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = psutil.Process(int(parent.stdout.readline()))
    end_family(parent.pid)
    parent.stdout.close()
    assert parent.wait(10) != 0
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE


def test_a_process_that_is_gone_already_is_no_trouble() -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    end_family(gone.pid)
