"""The decorators that compile the kernels of the pipeline.

Compiled code lies in a cache whose folders are named by the sources (see
`flowsculpt.render.base.kernel_cache`): only an edited source compiles (`flowsculpt doctor --prepare`, done at
set-up), nothing else ever does.

Intel's SVML has other sines and exponentials for vectors than for single numbers, so that a point's bits
would depend on its place in a block: commands and jobs keep numba from it (see `python_process`).
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import math
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, cached_property
from types import ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import sigutils
from numba.core.ccallback import CFunc
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.kernel_cache import (
    BLOCK_KERNELS,
    DECLARED,
    KernelCache,
    cached_kernel,
    formula_folder,
    one_at_a_time,
    release_after,
    use_kernel_cache,
)

F = TypeVar("F", bound=Callable[..., Any])


def kernel(signature: Any, **options: Any) -> Callable[[F], F]:
    """Return what compiles a function with numba, for arguments of the types that `signature` names.

    It is kept in our cache folder.

    Nothing is compiled or loaded on import: the first call loads what set-up has compiled, so that a
    process pays for the kernels it uses and no others.
    """

    def decorate(function: F) -> F:
        dispatcher: Any = cached_kernel(function, **options)
        arguments, _ = sigutils.normalize_signature(signature)
        resolve = dispatcher.get_call_template
        # Left to itself numba compiles a kernel anew for each literal, unsigned or writable argument.
        dispatcher.get_call_template = lambda args, kws: resolve(arguments, {})
        DECLARED.append((dispatcher, arguments))
        return one_at_a_time(dispatcher) if options.get("parallel") else dispatcher

    return decorate


def only_read(kind: Any) -> Any:
    """The type of an array that a kernel only reads. It is given such as `readable` makes, or frozen ones."""
    return kind.copy(readonly=True)


def readable(array: NDArray[Any], kind: type = np.float64) -> NDArray[Any]:
    """Return a read-only view of an array, or if need be a copy of that type, in C order.

    numba compiles a kernel for writable and for read-only arrays apart.
    """
    view: NDArray[Any] = np.ascontiguousarray(array, kind).view()
    view.flags.writeable = False
    return view


def in_threads(function: Callable[..., None], block: int, points: NDArray[Any], *others: Any) -> None:
    """Call a kernel of points (N, 3) in as many threads as numba may use, each for a run of whole blocks.

    others  its further arguments; the last is an array that it fills, a row for each point

    A kernel of `numba.prange` would be compiled beside the one for a single thread, in twice its time.
    """
    threads = min(numba.get_num_threads(), -(-len(points) // block))
    run = block * -(-len(points) // (block * max(threads, 1)))
    *given, out = others
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        parts = [slice(first, first + run) for first in range(0, len(points), run)]
        for _ in pool.map(lambda part: function(points[part], *given, out[part]), parts):
            pass  # raises what a thread has raised


def higher_kernel(function: F) -> F:
    """A kernel that takes kernels: written out in each that calls it, and filed with that one."""
    use_kernel_cache()
    return numba.njit(inline="always")(function)


_FLOATS = "CPointer(f8)"

BLOCK_SIGNATURE = f"void({_FLOATS}, i8, {', '.join([_FLOATS] * 3)}, f8, {', '.join([_FLOATS] * 3)})"
"""numbers, how many points, x, y, z, time in seconds, and u, v, w, to which the velocities are added."""


_COMPILES = threading.Lock()


class BlockKernel:
    """A function of BLOCK_SIGNATURE, called by its address; compiled or loaded when first used."""

    def __init__(self, function: Callable[..., None]) -> None:
        self._function = function

    @property
    def module(self) -> str:
        """The dotted name of the module that holds it."""
        return self._function.__module__

    @cached_property
    def _compiled(self) -> Any:
        use_kernel_cache()
        with _COMPILES:
            if "_compiled" in vars(self):  # by another thread, which may be calling it
                return vars(self)["_compiled"]
            signature = sigutils.normalize_signature(BLOCK_SIGNATURE)
            callback: Any = CFunc(self._function, signature, {}, {"error_model": "numpy"})
            callback._cache = KernelCache(self._function)
            release_after(callback.compile)()
            vars(self)["_compiled"] = callback
            return callback

    @property
    def address(self) -> int:
        """The address of the compiled function in this process, while this object lives."""
        return int(self._compiled.address)

    def __call__(self, numbers: Any, points: Any, time: float, out: Any) -> None:
        """Adds velocities at points (3, N) to `out` (3, N), both float64 with contiguous rows."""
        f8p = ctypes.POINTER(ctypes.c_double)
        p, *rows = (row.ctypes.data_as(f8p) for row in (numbers, *points, *out))
        self._compiled.ctypes(p, points.shape[1], *rows[:3], time, *rows[3:])


def block_kernel(function: Callable[..., None]) -> BlockKernel:
    """Compile the equation of a flow: `f(numbers, count, x, y, z, t, u, v, w)` adds velocities at points.

    Raises TypeError for a function with other parameters.
    """
    if len(inspect.signature(function).parameters) != 9:
        raise TypeError(
            f"{function.__name__} takes other parameters than numbers, count, x, y, z, t, u, v, w"
        )
    found = BlockKernel(function)
    BLOCK_KERNELS.append(found)
    return found


@cache
def generated_kernel(name: str, source: str) -> BlockKernel:
    """Return the function of a name, with the parameters of a `block_kernel`, of a generated source.

    The source may use `math` and `np`. It must follow from checked parts alone, for it is executed. A file
    that its digest names keeps it: numba caches by file name.
    """
    file = formula_folder() / f"{name}_{hashlib.sha256(source.encode()).hexdigest()[:24]}.py"
    if not file.exists():
        write_text(file, source, flush=False)  # whole: several processes may compile one at once
    module = ModuleType(file.stem)
    vars(module).update(math=math, np=np)
    sys.modules[file.stem] = module  # where numba looks up cached functions
    exec(compile(source, str(file), "exec", dont_inherit=True), vars(module))
    return BlockKernel(vars(module)[name])
