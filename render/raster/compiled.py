"""How kernels of the quick preview are compiled."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Array = NDArray[Any]

QUICK = {"contract", "reassoc", "arcp", "nsz"}
"""What may be done with sums and quotients: a picture for a moment need not have the same bits everywhere."""

exact, quick = compiled(), compiled(fastmath=QUICK)
