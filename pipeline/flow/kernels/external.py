"""Calls of functions by their address, and pointers to numbers by theirs.

An external function is what C would declare as

    void f(const double *numbers, int64_t n, const double *x, const double *y, const double *z, double t,
           double *u, double *v, double *w)

It *adds* its velocity at n points to u, v and w; `pipeline.kernels.block_kernel` makes one from a Python
function. Just before a closing bracket it may also multiply the sum of the group so far: a region of any
shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pipeline.arrays import Floats
from pipeline.flow.kernels.block import U, V, W, X, Y, Z
from pipeline.kernels import kernel

_DOUBLES = types.CPointer(types.float64)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def doubles_at(typingctx: Any, address: Any) -> Any:
    """Return a pointer to the doubles at an address: `carray(doubles_at(address), n)` reads them."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(_DOUBLES))

    return _DOUBLES(types.int64), generate


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def _call(typingctx: Any, address: Any, n: Any, t: Any, pointers: Any) -> Any:
    """Call the external function at an address; pointers: numbers, x, y, z, u, v, w."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, n, t, pointers = arguments
        numbers, x, y, z, u, v, w = (builder.extract_value(pointers, k) for k in range(7))
        given = [numbers, n, x, y, z, t, u, v, w]
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in given])
        builder.call(builder.inttoptr(address, kind.as_pointer()), given)
        return context.get_dummy_value()

    wanted = types.void(types.int64, types.int64, types.float64, types.UniTuple(_DOUBLES, 7))
    return wanted, generate


@kernel("void(f8[::1], i8, i8, f8[::1], i8)")
def call_external(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of an external function: address 0, time 1, its own numbers from 2 on."""
    numbers, runs = np.int64(p.ctypes.data) + 8 * (o + 2), np.int64(s.ctypes.data) + 8 * b
    pointers = (
        doubles_at(numbers),
        doubles_at(runs + 8 * X),
        doubles_at(runs + 8 * Y),
        doubles_at(runs + 8 * Z),
        doubles_at(runs + 8 * U),
        doubles_at(runs + 8 * V),
        doubles_at(runs + 8 * W),
    )
    _call(int(p[o]), n, p[o + 1], pointers)
