"""How vertex attributes go along when vertices come and go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray


class Heir(NamedTuple):
    """A vertex takes its attributes from `share` of the way from vertex a to vertex b."""

    vertex: int
    a: int
    b: int
    share: float


def inherited(
    attributes: Mapping[str, AnyArray], lineage: Sequence[Heir], kept: AnyArray
) -> dict[str, AnyArray]:
    """The attributes after a frame: told by its lineage, in order, for the vertices that are `kept`.

    Floating numbers mix; integers and flags are those of the nearer parent, `a` where both are as near.
    """
    after = {}
    for name, values in attributes.items():
        rows = np.zeros(
            (max([len(values), *(heir.vertex + 1 for heir in lineage)]), *values.shape[1:]), values.dtype
        )
        rows[: len(values)] = values
        if values.dtype.kind == "f":
            for vertex, a, b, share in lineage:
                rows[vertex] = rows[a] + (rows[b] - rows[a]) * share if share < 1 else rows[b]
        else:
            for vertex, a, b, share in lineage:
                rows[vertex] = rows[b] if share > 0.5 else rows[a]
        after[name] = rows[kept]
    return after
