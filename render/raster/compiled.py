"""How kernels of the quick preview are compiled."""

from __future__ import annotations

from typing import Any

import numba
from numpy.typing import NDArray

Array = NDArray[Any]

QUICK = {"contract", "reassoc", "arcp", "nsz"}
"""What may be done with sums and quotients: a picture for a moment need not have the same bits everywhere."""

exact = numba.njit(cache=True, nogil=True, error_model="numpy")
quick = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=QUICK)
