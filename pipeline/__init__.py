"""flowsculpt: from a shot file to mesh frames, and the production around them.

The layers import downwards only; `docs/house.md` draws them.
"""

import os

os.environ["NUMBA_DISABLE_INTEL_SVML"] = "1"  # looked at when numba is first imported: see kernels.py
