"""The memory-bound limit: one pass over all edges that computes their squared lengths, one thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar, cast

import numba

from flowsculpt.pipeline.arrays import Indices, Points

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile with numba for this process only; a baseline needs no cache."""
    return cast(F, numba.njit(fastmath=True)(function))


@compiled
def edge_pass(points: Points, edges: Indices, bound: float) -> int:
    """Count the edges whose squared length exceeds the bound."""
    count = 0
    for i in range(len(edges)):
        a, b = edges[i, 0], edges[i, 1]
        x = points[a, 0] - points[b, 0]
        y = points[a, 1] - points[b, 1]
        z = points[a, 2] - points[b, 2]
        count += (x * x + y * y + z * z) > bound
    return count


def best_of(work: Callable[[], object], repeats: int) -> float:
    """Return the seconds of the quickest of `repeats` runs, after one to warm up."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)
