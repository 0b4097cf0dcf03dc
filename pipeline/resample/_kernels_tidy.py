"""Collapsing and flipping in turns, until neither can do any more."""

from __future__ import annotations

import numba

from pipeline.arrays import Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, SURFACE, VECTOR, Surface
from pipeline.resample._kernels_collapse import RINGS, collapse_due, recall
from pipeline.resample._kernels_flip import flip_fresh
from pipeline.resample._kernels_lists import CHANGES, Changes
from pipeline.resample._kernels_ring import Ring

_DEAD = numba.types.UniTuple(INTS, 2)
_PAIR = numba.types.UniTuple(numba.int64, 2)


@kernel(_PAIR(SURFACE, VECTOR, RINGS, CHANGES, _DEAD, INTS, INTS))
def tidy(
    surface: Surface,
    limits: Floats,
    rings: tuple[Ring, Ring],
    changes: Changes,
    dead: tuple[Indices, Indices],
    obtuse: Indices,
    again: Indices,
) -> tuple[int, int]:
    """Collapse what is due, flip what that leaves badly shaped, recall what may then collapse, and so on.

    Answers how many collapses and flips. Every edge that is short afterwards stands in `changes.shorts`
    with the reason. It ends because every round but the last takes a vertex away. `dead` lists the faces and
    vertices that are gone.
    """
    collapses = flips = 0
    while True:
        done = collapse_due(surface, limits, rings, changes, dead[0], dead[1])
        collapses += done
        flips += flip_fresh(surface, limits, changes, obtuse, again)
        if recall(surface, changes) == 0:
            return collapses, flips
