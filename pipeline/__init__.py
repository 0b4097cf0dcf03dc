"""flowsculpt: from a shot file to mesh frames, and the production around them.

The layers import downwards only; `docs/architecture.md` draws them.
"""

import os

os.environ["NUMBA_DISABLE_INTEL_SVML"] = "1"  # looked at when numba is first imported: see kernels.py

# Threads that wait for the rest of a kernel sleep. Left to itself libgomp has them spin, and where others
# work beside, a kernel for a hundred points then takes 10 ms, not 5 µs. It looks once, when it is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import flowsculpt.render  # noqa: F401  # reads no settings of numba from the working folder; after what numba looks at
