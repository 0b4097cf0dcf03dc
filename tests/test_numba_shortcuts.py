"""The process that compiles kernels takes shortcuts through numba, which must change nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from flowsculpt.render.base.kernel_build import kernels_called_by_kernels
from flowsculpt.render.base.numba_shortcuts import VERSIONS

ROOT = Path(__file__).parents[1]

COMPARED = """
import numba
import numpy as np
from flowsculpt.render.base.numba_shortcuts import take_shortcuts

def total(values):
    copy = np.zeros(len(values))
    for i in range(len(values)):
        copy[i] = max(values[i], 2.0)
    return copy.sum()

def results():
    compiled = numba.njit("f8(f8[::1])", error_model="numpy")(total)
    values = np.linspace(-3.0, 9.0, 1001) / 7.0
    return [compiled(values[first:]).hex() for first in range(9)]

before = results()
take_shortcuts()
assert results() == before
"""

UNKNOWN = """
import numba
numba.__version__ = "0.69.0"
from numba.core.types.functions import BaseFunction
before = BaseFunction.get_call_type
from flowsculpt.render.base.numba_shortcuts import take_shortcuts
take_shortcuts()
assert BaseFunction.get_call_type is before
"""


@pytest.mark.slow
@pytest.mark.parametrize("code", [COMPARED, UNKNOWN])
def test_shortcuts_change_no_results_and_another_numba_not_at_all(code: str) -> None:
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_shortcuts_know_the_version_of_numba_that_is_installed() -> None:
    assert numba.__version__.startswith(VERSIONS), "look at each shortcut again, then at its kernels' speed"


SUMS = """
import numpy as np
from flowsculpt.render.base.kernel_cache import cached_kernel

@cached_kernel
def half(number):
    return number / 2.0

@cached_kernel
def sum_of_halves(numbers):
    total = 0.0
    for number in numbers:
        total += half(number)
    return total

def call():
    return sum_of_halves(np.array([1.0, 4.0]))
"""

COMPILE_ONLY = """
from flowsculpt.render.base.numba_shortcuts import take_shortcuts
take_shortcuts({("sums", "half")})
import sums
print(sums.call())
try:
    sums.half(3.0)
except TypeError:
    print("not called")
"""

USE = """
import sums
print(sums.call(), len(sums.sum_of_halves.stats.cache_hits), sums.half(3.0))
"""


@pytest.mark.slow
def test_a_kernel_that_only_kernels_call_has_no_machine_code_until_python_calls_it(tmp_path: Path) -> None:
    (tmp_path / "sums.py").write_text(SUMS)
    caches = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    said = []
    for code in (COMPILE_ONLY, COMPILE_ONLY, USE):
        command = [sys.executable, "-c", code]
        run = subprocess.run(command, env={**os.environ, **caches}, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        said.append(run.stdout.split("\n")[:-1])
    assert said == [["2.5", "not called"], ["2.5", "not called"], ["2.5 1 1.5"]]
    kinds = {path.name.split("-")[0]: path.suffix for path in sorted(tmp_path.rglob("*.inner"))}
    assert kinds == {"half": ".inner"}


BLOCKS = """
from flowsculpt.pipeline.kernels import block_kernel

@block_kernel
def drift(numbers, count, x, y, z, t, u, v, w):
    for i in range(count):
        u[i] += numbers[0]
"""

COMPILE_BLOCKS = """
from flowsculpt.render.base.numba_shortcuts import take_shortcuts
take_shortcuts()
import blocks
assert blocks.drift.address
"""


@pytest.mark.slow
def test_a_kernel_that_is_called_by_its_address_is_filed_as_optimised_machine_code(tmp_path: Path) -> None:
    (tmp_path / "blocks.py").write_text(BLOCKS)
    caches = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    command = [sys.executable, "-c", COMPILE_BLOCKS]
    run = subprocess.run(command, env={**os.environ, **caches}, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    (filed,) = tmp_path.rglob("drift-*.kernel")
    assert b"object" in filed.read_bytes() and b"bitcode" not in filed.read_bytes()


@pytest.mark.slow
def test_no_kernel_that_python_calls_counts_as_called_by_kernels_alone() -> None:
    inner = kernels_called_by_kernels()
    assert ("flowsculpt.pipeline.resample.kernels.collapse", "collapse_and_flip") not in inner
    assert ("flowsculpt.pipeline.flow.kernels.streamline_kernels", "advect") not in inner
    assert ("flowsculpt.pipeline.flow.kernels.streamline_kernels", "advance_span") in inner
    assert ("flowsculpt.pipeline.resample.kernels.collapse", "can_collapse") in inner
    assert len(inner) > 200
