"""The process from which all processes that compile kernels are forked; nothing else imports this module.

They share what it imports and compiles, and what numba learns from it.
"""

import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the process that started this one
gc.disable()  # a compiler needs what it holds to its end

# Both settings must hold while these are imported:
from flowsculpt.render.base.kernel_build import compile_module, kernels_called_by_kernels  # noqa: E402
from flowsculpt.render.base.numba_shortcuts import take_shortcuts  # noqa: E402

take_shortcuts(kernels_called_by_kernels())
compile_module("flowsculpt.pipeline.mesh.kernels.face_measures")  # small, and typical of all
