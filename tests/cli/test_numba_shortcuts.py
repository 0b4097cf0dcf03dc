"""The process that compiles kernels takes shortcuts through numba, which must change nothing else."""

import subprocess
import sys

COMPARED = """
import re
import numba
import numpy as np
from numba.core import ir
from numba.core.compiler import Flags, run_frontend
from pipeline.cli.numba_shortcuts import take_shortcuts

def total(values):
    copy = np.zeros(len(values))
    for i in range(len(values)):
        copy[i] = max(values[i], 2.0)
    return copy.sum()

def variables():
    blocks = run_frontend(total).blocks.values()
    return [sorted(var.name for var in line.list_vars()) for block in blocks for line in block.body]

def assembly():
    compiled = numba.njit("f8(f8[::1])", error_model="numpy")(total)
    assert compiled(np.array([1.0, 3.0])) == 5.0
    text, = compiled.inspect_asm().values()
    return re.findall(r"^\\t([a-z]\\w*)", text, re.M)

def options():
    changed = Flags()
    changed.no_cfunc_wrapper = changed.nrt = True
    unset = Flags()
    unset.nrt = Flags().nrt
    return [flags.values() for flags in (Flags(), changed, unset)]

before = variables(), options(), assembly()
take_shortcuts()
assert any(before[0])
assert (variables(), options(), assembly()) == before
unset = Flags()
unset.nrt = Flags().nrt
assert unset == Flags() and hash(unset) == hash(Flags())
"""


def test_code_compiled_with_shortcuts_is_the_same() -> None:
    run = subprocess.run([sys.executable, "-c", COMPARED], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
