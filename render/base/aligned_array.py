"""Arrays for Dr.Jit and from it, in ways for which it always compiles the same code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

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


def aligned_columns(array: NDArray[np.floating]) -> list[Any]:
    """Return the columns (N,) of an array (N, K), for a vector of Dr.Jit.

    Given an array (K, N), Dr.Jit takes it apart by code that it compiles again for each N.
    """
    return [aligned(column, np.float32) for column in array.T]


def components(vector: Any) -> NDArray[Any]:
    """Return the components (K, N) of a vector of Dr.Jit, which compiles code for each N to join them."""
    return np.stack([np.array(component) for component in vector])
