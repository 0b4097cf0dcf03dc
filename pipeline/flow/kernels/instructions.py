"""Instructions of velocity programs, the block of points they work on, and calls of external functions.

A program is a list of rows: an opcode and up to `COLUMNS` numbers. Its rows run in order, each on a whole
block of points. A field adds its velocity; brackets make compositions part of the same program:

    OPEN … CLOSE        the fields between are summed apart, and added with a factor
    OPEN … CLOSE_…      the same, with a factor inside a region, another outside, and a falloff between
    PLACE … UNPLACE     the fields between see points in a transformed frame; velocities are transformed back

Brackets nest to any depth. The numbers of a field are listed with its equation.

Points are handled `BLOCK` at a time, coordinates apart, in one flat scratch array small enough for the
nearest cache. A *level* is six runs of BLOCK numbers: x, y, z of the points and u, v, w of their velocities
so far. A level begins at an offset `b`; the level of the next bracket follows at b + LEVEL.

All offsets within a level are constants, and a level is sliced before its loop, so that the compiler sees
that runs do not overlap and indices are not negative, and handles several points at once. A point's
arithmetic does not depend on its place in a block: results have the same bits for any number of points and
of threads.

An external function is what C would declare as

    void f(const double *numbers, int64_t n, const double *x, const double *y, const double *z, double t,
           double *u, double *v, double *w)

It *adds* its velocity at n points to u, v and w; `flowsculpt.pipeline.kernels.block_kernel` makes one from a
Python function. Just before a closing bracket it may also multiply the sum of the group so far: a region of
any shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.kernels import higher_kernel, kernel

COLUMNS = 13
"""Numbers in a row: an external function has its address, the time and eleven of its own."""

OPEN = 1  # no numbers
PLACE = 2  # centre 0:3, matrix 3:12 row by row: inside, points are matrix · (point − centre)
CLOSE = 3  # factor 0
CLOSE_BALL = 4  # centre 0:3, radius 3
CLOSE_BOX = 5  # centre 0:3, half its sides 3:6
CLOSE_HALF_SPACE = 6  # point on the plane 0:3, unit normal outwards 3:6
CLOSE_CAPSULE = 7  # centre 0:3, unit axis 3:6, half the length of its line 10, radius 11
CLOSE_CYLINDER = 8  # centre 0:3, unit axis 3:6, half its length 10, radius 11
CLOSE_MESH = 10  # a closed surface: position of its origin 0:3, scale 3, address of the numbers 4
# all regions: falloff 6, factor inside 7, factor outside 8, type of the falloff 9 (see `regions`)
UNPLACE = 11  # -, matrix 3:12: outside, velocities are matrix · velocity

EXTERNAL = 12  # address of a compiled function 0, time 1, its own numbers 2:13 (see `call_external`)

LINEAR, VORTICES, EXPANSION, ATTRACTORS, CELLULAR = 16, 32, 48, 64, 80
"""The first opcode of each family, whose kernels number its fields from there."""

DEFORMATIONS = 96
"""The first opcode of the deformations, which move points and have no velocity: see `deformation_kernels`."""

MAP = 127
"""An external function whose results are displacements; its row is that of EXTERNAL."""


BLOCK = 256
X, Y, Z, U, V, W = (BLOCK * run for run in range(6))
LEVEL = 6 * BLOCK

PARALLEL_FROM = 8000
"""Points × sub-steps from which on several threads are faster than one."""

Velocity = tuple[float, float, float]

EQUATION = "UniTuple(f8, 3)(f8[::1], i8, f8, f8, f8)"
"""The signature of an equation: (numbers, start of its row among them, x, y, z) -> velocity."""

FIELD = "void(i4, f8[::1], i8, i8, f8[::1], i8)"
"""The signature of `add_field`: (opcode, numbers, start of the row, n points, scratch, start of level)."""


@higher_kernel
def add_each(equation: Any, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of an equation, whose row begins at p[o], to n points of the level at s[b]."""
    row, level = p[o:], s[b:]
    for i in range(n):
        u, v, w = equation(row, 0, level[X + i], level[Y + i], level[Z + i])
        level[U + i] += u
        level[V + i] += v
        level[W + i] += w


@kernel("void(f8[::1], i8)")
def clear_velocities(s: Floats, b: int) -> None:
    """Set the velocities of the level at s[b] to zero."""
    s[b + U : b + LEVEL] = 0.0


@kernel("void(f8[:, ::1], i8, i8, f8[::1], i8)")
def load(points: Points, first: int, n: int, s: Floats, at: int) -> None:
    """Copy points[first : first + n], coordinates apart, into three runs at s[at]."""
    runs, block = s[at:], points[first:]
    for i in range(n):
        runs[X + i] = block[i, 0]
        runs[Y + i] = block[i, 1]
        runs[Z + i] = block[i, 2]


@kernel("void(f8[::1], i8, i8, i8, f8[:, ::1])")
def store(s: Floats, at: int, first: int, n: int, out: Points) -> None:
    """Copy three runs at s[at] into out[first : first + n]."""
    runs, block = s[at:], out[first:]
    for i in range(n):
        block[i, 0] = runs[X + i]
        block[i, 1] = runs[Y + i]
        block[i, 2] = runs[Z + i]


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
