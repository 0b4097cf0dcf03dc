"""Of which earlier vertices the vertices of a surface descend, by the records of births in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import UsageError


@dataclass(frozen=True, eq=False)
class Ancestry:
    """A sparse matrix (V, U) that has earlier vertices' shares in the vertices of now, row after row.

    heirs      int64 (K,) vertices now, ascending
    ancestors  int64 (K,) vertices then, ascending for each heir
    weights    float64 (K,) above 0; those of an heir add up to 1
    """

    heirs: AnyArray
    ancestors: AnyArray
    weights: Floats

    @property
    def survives(self) -> AnyArray:
        """(V,) bool: which vertices were there then. Whoever was born since has two ancestors at least."""
        survives: AnyArray = np.bincount(self.heirs) == 1
        return survives

    def mixed(self, values: AnyArray) -> Floats:
        """(V, …) the weighted means of what the vertices had then, (U, …): for a survivor its own."""
        flat = np.asarray(values, np.float64).reshape(len(values), -1)
        mixed = np.empty((len(self.survives), flat.shape[1]))
        for k, column in enumerate(flat.T):
            mixed[:, k] = np.bincount(self.heirs, self.weights * column[self.ancestors])
        return mixed.reshape(-1, *np.shape(values)[1:])


def ancestry(now: AnyArray, then: AnyArray, births: AnyArray) -> Ancestry:
    """Of whom the vertices of now descend: each birth is the mean of its two parents.

    now     (V,) the attribute `identity` of the later surface
    then    (U,) that of the earlier one
    births  (N, 3) the records of all births after `then`, up to `now`, in order; earlier ones do no harm

    Weights are sums of powers of one half, and exact over fifty generations. A collapse shows in them only
    in who is left: a survivor is its own whole ancestor, even where it has moved to the middle of its edge.

    Raises UsageError where the births are out of order, or those of a vertex are missing.
    """
    if not (np.diff(births[:, 0]) > 0).all():
        raise UsageError("births are not in order; give those of all frames in between, one after the other")
    heirs, names, weights = np.arange(len(now)), np.asarray(now, np.int64), np.ones(len(now))
    by_name = np.argsort(then)
    settled = [(heirs[:0], by_name[:0], weights[:0])]
    while len(heirs):
        place = _found(names, then[by_name])
        old = place >= 0
        settled.append((heirs[old], by_name[place[old]], weights[old]))
        heirs, names, weights = heirs[~old], names[~old], weights[~old]
        birth = _found(names, births[:, 0])
        if (birth < 0).any():
            raise UsageError(
                f"vertex {names[birth < 0][0]} is neither of the earlier surface nor among the births; give "
                "those of all frames in between"
            )
        heirs, weights = np.tile(heirs, 2), np.tile(0.5 * weights, 2)
        heirs, names, weights = _merged(heirs, births[birth, 1:].T.reshape(-1), weights)
    heirs, ancestors, weights = (np.concatenate(part) for part in zip(*settled, strict=True))
    return Ancestry(*_merged(heirs, ancestors, weights))


def _found(wanted: AnyArray, ascending: AnyArray) -> AnyArray:
    """(N,) where numbers stand in an ascending row; -1 where they do not."""
    place = np.searchsorted(ascending, wanted)
    there = place < len(ascending)
    there[there] = ascending[place[there]] == wanted[there]
    found: AnyArray = np.where(there, place, -1)
    return found


def _merged(heirs: AnyArray, names: AnyArray, weights: Floats) -> tuple[AnyArray, AnyArray, Floats]:
    """Each pair of an heir and a name once, in order, with the sum of its weights."""
    order = np.lexsort((names, heirs))
    heirs, names, weights = heirs[order], names[order], weights[order]
    begins = np.flatnonzero(np.append(True, np.diff(heirs) | np.diff(names))[: len(heirs)])
    return heirs[begins], names[begins], np.add.reduceat(weights, begins) if len(begins) else weights
