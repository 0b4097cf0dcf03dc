"""Velocities at one time whose chunks are read when points first need them, and the field that reads so."""

from __future__ import annotations

import ctypes
import math
import mmap
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from operator import attrgetter, methodcaller
from threading import Lock
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from flowsculpt.api.flows import Sampled, StableProperty, block_kernel, kernel
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.grid_layout import Box

IS_READ, IS_WANTED, READING, SAMPLED, COUNTS, ENDS = 0, 1, 2, 3, 4, 7
"""What a table has: addresses of the arrays of `TimeChunks`, of what reads chunks and of the kernel of
`Sampled`; the numbers of chunks along the axes; and for each chunk along an axis the least and the largest
coordinate of points that need it."""

TRIES = 2  # Ctrl-C may end the first one before it begins

_DOUBLES = types.CPointer(types.float64)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def _call(
    typingctx: Any, address: Any, numbers: Any, n: Any, x: Any, y: Any, z: Any, t: Any, u: Any, v: Any, w: Any
) -> Any:
    """Call the function of a block kernel at an address; it sees the chunks that other threads have read."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, *given = arguments
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in given])
        builder.fence("acquire")
        builder.call(builder.inttoptr(address, kind.as_pointer()), given)
        return context.get_dummy_value()

    points = [_DOUBLES] * 3
    return types.void(types.int64, _DOUBLES, types.int64, *points, types.float64, *points), generate


@kernel("f8[::1](voidptr)")
def floats_at(address: int) -> Floats:
    """Return the float64 numbers from an address on, however many there are."""
    numbers: Floats = carray(address, (1 << 40,), np.float64)
    return numbers


@kernel("b1(f8[::1], b1, f8, f8, f8, f8, f8, f8)")
def is_lacking(
    table: Floats, marks: bool, x0: float, x1: float, y0: float, y1: float, z0: float, z1: float
) -> bool:
    """Tell whether points between two corners need a chunk that is not read yet; `marks` it as wanted."""
    is_read, is_wanted, lacking = floats_at(int(table[IS_READ])), floats_at(int(table[IS_WANTED])), False
    nx, ny, nz = int(table[COUNTS]), int(table[COUNTS + 1]), int(table[COUNTS + 2])
    y, z = ENDS + 2 * nx, ENDS + 2 * (nx + ny)
    for i in range(nx):
        for j in range(ny if table[ENDS + 2 * i] <= x1 and x0 <= table[ENDS + 2 * i + 1] else 0):
            for k in range(nz if table[y + 2 * j] <= y1 and y0 <= table[y + 2 * j + 1] else 0):
                at = (i * ny + j) * nz + k
                if is_read[at] == 0.0 and table[z + 2 * k] <= z1 and z0 <= table[z + 2 * k + 1]:
                    lacking = True
                    if marks:
                        is_wanted[at] = 1.0
    return lacking


@block_kernel
def sampled_by_chunk(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Read the chunks that points need; then do what `sampled` does. Where one fails, velocities are NaN.

    Numbers: those of `sampled`, and the addresses of the tables of both times, 9 and 10.
    """
    cx, cy, cz, shrink = numbers[4], numbers[5], numbers[6], 1.0 / numbers[7]
    x0, y0, z0, x1, y1, z1 = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for i in range(count):
        px, py, pz = (x[i] - cx) * shrink, (y[i] - cy) * shrink, (z[i] - cz) * shrink
        x0, y0, z0 = min(x0, px), min(y0, py), min(z0, pz)
        x1, y1, z1 = max(x1, px), max(y1, py), max(z1, pz)
    failed = False
    for which in range(2 if numbers[3] > 0.0 else 1):
        table, tries = floats_at(int(numbers[9 + which])), 0
        lacking = is_lacking(table, False, x0, x1, y0, y1, z0, z1)  # seldom: points are seldom looked at
        while lacking and tries <= TRIES:
            lacking = False
            for i in range(count):
                px, py, pz = (x[i] - cx) * shrink, (y[i] - cy) * shrink, (z[i] - cz) * shrink
                lacking |= is_lacking(table, True, px, px, py, py, pz, pz)
            if lacking and tries < TRIES:
                _call(int(table[READING]), numbers, count, x, y, z, t, u, v, w)
            tries += 1
        failed |= lacking
    _call(int(floats_at(int(numbers[9]))[SAMPLED]), numbers, count, x, y, z, t, u, v, w)
    for i in range(count if failed else 0):
        u[i], v[i], w[i] = np.nan, np.nan, np.nan


class TimeChunks:
    """Velocities (X, Y, Z, 3) at one time, of which chunks are read when a kernel first needs them.

    parts      along each axis the nodes of chunks
    read       writes the nodes of a chunk to the velocities, and may raise anything
    is_read    (C,) 1 for each chunk that was read, in C order, else 0; kernels read it
    is_wanted  (C,) 1 for each chunk that a kernel has needed; a chunk that could not be read is 0 again
    """

    def __init__(
        self,
        velocity: np.ndarray,
        parts: tuple[list[slice], ...] = (),
        read: Callable[[np.ndarray, Box], None] = lambda out, box: None,
        is_read: Floats | None = None,
    ) -> None:
        self._velocity, self._parts, self._read = velocity, parts, read
        self._boxes: list[Any] = list(product(*parts))
        self.is_read = np.zeros(len(self._boxes)) if is_read is None else is_read
        self.is_wanted = np.zeros(len(self._boxes))
        self._lock, self._tables = Lock(), dict[int, Floats]()
        self._failure: BaseException | None = None

    @property
    def velocity(self) -> np.ndarray:
        """The array with the chunks so far. Raises what reading one for a kernel has raised."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
        return self._velocity

    def whole(self) -> np.ndarray:
        """Return the velocities with all chunks."""
        with self._lock:
            self._fill(np.flatnonzero(self.is_read == 0.0))
        return self._velocity

    def _fill(self, chosen: np.ndarray) -> None:
        for k in chosen:
            self._read(self._velocity, self._boxes[k])
            self.is_read[k] = 1.0

    def _fill_wanted(self) -> None:
        """Read what kernels want. They pass no errors on: `velocity` raises them when next asked."""
        try:
            with self._lock:
                chosen = np.flatnonzero((self.is_wanted > 0.0) & (self.is_read == 0.0))
                try:
                    self._fill(chosen)
                except BaseException:
                    self.is_wanted[chosen] = 0.0  # so that it does not stop points elsewhere
                    raise
        except BaseException as error:  # also Ctrl-C
            self._failure = self._failure or error

    @StableProperty
    def _reading(self) -> Any:
        three, fill = [ctypes.c_void_p] * 3, weakref.WeakMethod(self._fill_wanted)  # in no cycle
        kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, *three, ctypes.c_double, *three)
        return kind(lambda *_: fill()())  # type: ignore[misc]  # kernels are given what lives

    def table(self, axes: tuple[Floats, Floats, Floats], more: int) -> Floats:
        """Return what kernels read of it: see ENDS.

        axes  coordinates of the nodes
        more  nodes on either side of a cell whose velocities its points need, besides those at its ends
        """
        if more not in self._tables:
            ends: list[float] = []
            for axis, parts in zip(axes, self._parts, strict=True):
                for part in parts:
                    low, high = part.start - 1 - more, part.stop + more
                    ends.append(axis[low] if low > 0 else -np.inf)
                    ends.append(axis[high] if high < len(axis) - 1 else np.inf)
            reading = ctypes.cast(self._reading, ctypes.c_void_p).value
            states = self.is_read.ctypes.data, self.is_wanted.ctypes.data
            table = [*states, reading, Sampled.block.address, *map(len, self._parts), *ends]
            self._tables.setdefault(more, np.array(table, np.float64))  # threads get the same one
        return self._tables[more]


def small_pages(shape: tuple[int, ...]) -> np.ndarray:
    """Return float32 zeros in pages of 4 kB: a chunk touches few of them, and most of the large ones."""
    if not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape, np.float32)
    memory = mmap.mmap(-1, 4 * math.prod(shape), mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, np.float32).reshape(shape)


class _Address:
    """The address of an array of a time, which is opened when a table takes it, and kept from then on.

    Taking it raises what reading a chunk for a kernel has raised meanwhile.
    """

    def __init__(self, opened: Callable[[], TimeChunks], make: Callable[[TimeChunks], np.ndarray]) -> None:
        self._opened, self._make = opened, make

    def __float__(self) -> float:
        return float(self._make(self._opened()).ctypes.data)


@dataclass(frozen=True)
class SampledByChunk(Sampled):
    """The velocities of `Sampled`, of which only the chunks that points touch are read.

    Its samples have `parts`, and it does not repeat.
    """

    block: ClassVar[Any] = sampled_by_chunk
    can_diagnose = True  # why a chunk cannot be read: `numbers` raises it

    @property
    def name(self) -> str:
        return "sampled"

    def numbers(self, time: float) -> tuple[Any, ...]:
        memory, _, _, share, *place = super().numbers(time)
        before, after, _ = self.moment(time)
        first = cache(partial(self.samples.chunks, before))  # type: ignore[attr-defined]
        times = first, cache(partial(self.samples.chunks, after)) if share else first  # type: ignore[attr-defined]
        more = int(self.between == "cubic")
        arrays = [_Address(each, attrgetter("velocity")) for each in times]
        tables = [_Address(each, methodcaller("table", self.samples.axes, more)) for each in times]
        return memory, *arrays, share, *place, *tables
