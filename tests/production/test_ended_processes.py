"""The processes that a run starts end with it."""

import subprocess
import sys

import psutil
import pytest

from flowsculpt.pipeline.production.execution.snakemake import end_family
from tests.processes import has_ended, wait_until

pytestmark = pytest.mark.quick

PARENT = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
print(child.pid, flush=True)
child.wait()
"""


@pytest.mark.slow
def test_a_process_ends_with_all_that_it_started() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = psutil.Process(int(parent.stdout.readline()))
    end_family(parent.pid)
    parent.stdout.close()
    parent.wait(120)
    assert not psutil.pid_exists(parent.pid)
    wait_until(lambda: has_ended(child))


def test_a_process_that_is_gone_already_is_no_trouble_and_others_go_on() -> None:
    gone, other = subprocess.Popen(["true"]), subprocess.Popen(["sleep", "60"])
    gone.wait()
    end_family(gone.pid)
    assert other.poll() is None
    other.kill()
    other.wait()
