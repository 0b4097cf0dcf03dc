"""Maps undone without a formula for their inverse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FrameError

CLOSE = 1e-14
"""How near the image of the point found lies to the point given, as a share of how far out both are."""

MOST_TURNS = 100


def undone(move: Callable[[Points], Points], points: Points, name: str) -> Points:
    """The points (N, 3) that `move` takes to `points`: q with move(q) = p, by q ← q + p − move(q).

    The turns close in where two points move differently by less than they lie apart, as they do in the step
    of a frame that folds nothing. Each point takes turns until it is there, whatever the others do.

    Raises FrameError, which calls the map `name`, where that does not come about.
    """
    found = np.array(points, dtype=np.float64)
    waiting = np.arange(len(found))
    size = CLOSE * (1.0 + np.abs(found).max(axis=1, initial=0.0))
    for _ in range(MOST_TURNS):
        missed = points[waiting] - move(found[waiting])
        found[waiting] += missed
        waiting = waiting[~(np.abs(missed).max(axis=1, initial=0.0) <= size[waiting])]
        if not len(waiting):
            return found
    where = ", ".join(f"{x:.4g}" for x in points[waiting[0]])
    raise FrameError(
        f"flow {name} cannot be undone at ({where}): there it folds the space within a frame. "
        "Lower its strength or widen its falloff."
    )
