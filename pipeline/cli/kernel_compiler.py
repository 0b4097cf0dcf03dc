"""The process that all those are forked from that compile kernels, which imports this and nothing else does.

What it imports and compiles, and what numba finds out on the way, they need not each for themselves.
"""

import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the one that starts it
gc.disable()  # what a compiler holds is needed to the end

from pipeline.cli.kernel_build import kernels_called_by_kernels  # noqa: E402
from pipeline.cli.numba_shortcuts import take_shortcuts  # noqa: E402
from pipeline.kernels import compile_module  # noqa: E402

take_shortcuts(kernels_called_by_kernels())
compile_module("pipeline.mesh.kernels.face_measures")  # small, and typical of all
