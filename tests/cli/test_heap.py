"""Settings of the C library's heap that the command line makes."""

import platform
import subprocess
import sys

import pytest

SCRIPT = """
import resource
from flowsculpt.pipeline.cli.app import keep_freed_memory

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

def of_arrays():
    before = faults()
    for _ in range(50):
        [bytearray(2**21) for _ in range(6)]
    return faults() - before

before = faults()
keep_freed_memory()
print(faults() - before, of_arrays())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="others have their own ways")
def test_arrays_of_a_frame_get_the_memory_of_the_one_before():
    """6 of 512 pages each, 50 times: touched once or twice. What teaches it that is not touched at all."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    itself, of_arrays = map(int, done.stdout.split())
    assert itself < 50
    assert of_arrays < 5 * 6 * 512
