"""Carry values along births, the splits of edges that refined a surface, to parents or from them."""

from __future__ import annotations

import numba

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats, Indices

_TABLE = numba.int32[:, ::1]
_VALUES = numba.float64[::1]


@kernel((_TABLE, _TABLE, numba.int64, _VALUES))
def raise_to_dependents(births: Indices, opposite: Indices, first: int, errors: Floats) -> None:
    """Raise the errors (V,) of vertices to those of the births that need them, from the last birth on.

    A birth needs its parents and the corners opposite its edge; `first` is the vertex of the first birth.
    """
    for i in range(len(births) - 1, -1, -1):
        for pair in (births, opposite):
            for k in range(2):
                if pair[i, k] >= 0:
                    errors[pair[i, k]] = max(errors[pair[i, k]], errors[first + i])


@kernel((_TABLE, numba.int64, _VALUES))
def mix_births(births: Indices, first: int, values: Floats) -> None:
    """Set the values (V,) of births, from vertex `first` on, to the means of their parents, in order."""
    for i in range(len(births)):
        values[first + i] = 0.5 * (values[births[i, 0]] + values[births[i, 1]])
