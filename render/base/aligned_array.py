"""Arrays at addresses for which Dr.Jit always compiles the same code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

ALIGNMENT = 64


def aligned(array: ArrayLike, dtype: DTypeLike) -> Any:
    """Return the values in a row, in a copy whose address is a multiple of ALIGNMENT.

    Dr.Jit loads values at other addresses by slower code. NumPy's addresses vary from frame to frame, so each
    kernel would be compiled in both ways.
    """
    values = np.asarray(array)
    size = values.size * np.dtype(dtype).itemsize
    buffer = np.empty(size + ALIGNMENT, np.uint8)
    first = -buffer.ctypes.data % ALIGNMENT
    copy = buffer[first : first + size].view(dtype)
    copy.reshape(values.shape)[...] = values
    return copy
