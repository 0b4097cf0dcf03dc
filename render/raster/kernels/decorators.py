"""Decorators of the quick preview's kernels."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Array = NDArray[Any]

FAST_MATH = {"contract", "reassoc", "arcp", "nsz"}
"""Fast-math flags. A preview need not have the same bits on every processor."""

exact, fast = compiled(), compiled(fastmath=FAST_MATH)
"""`exact` keeps the order of operations, `fast` lets the compiler change it."""
