"""Identities of vertices, never given twice, and the ancestry that recorded births give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.errors import MeshError, UsageError
from pipeline.mesh.triangle_mesh import TriangleMesh

IDENTITY = "identity"
"""Vertex attribute (V,), int64, that tells the vertices of a film apart."""

_LARGEST = 1 << 53  # attributes are stored as float64, which has no larger odd integers
_NO_BIRTHS = np.empty((0, 3), np.int64)


def with_identities(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with its vertices numbered from 0: the start of a film."""
    return mesh.with_attributes(**{IDENTITY: np.arange(len(mesh.vertices), dtype=np.int64)})


class Register:
    """The births of one frame, and the number of identities ever given.

    given   number of identities given: the next vertex gets this one
    births  int64 (N, 3), in order of birth: identities of a vertex and its two parents; includes vertices
            that died within the frame
    """

    def __init__(self, given: int) -> None:
        self.given = given
        self._records: list[AnyArray] = []

    @classmethod
    def of(cls, mesh: TriangleMesh, given: int = 0) -> Register | None:
        """Return the register of a mesh after that many identities; None if it has none.

        Raises MeshError where identities are not different numbers, int64 and from 0 on.
        """
        if IDENTITY not in mesh.attributes:
            return None
        numbers = mesh.attributes[IDENTITY]
        if numbers.ndim != 1 or numbers.dtype != np.int64:
            raise MeshError(
                f"attribute {IDENTITY!r} holds {numbers.dtype} of shape {numbers.shape}; it must be one "
                "int64 for each vertex. Rename it if it means something else"
            )
        ordered = np.sort(numbers)
        low, high = int(ordered.min(initial=0)), int(ordered.max(initial=-1))
        if (np.diff(ordered) == 0).any() or low < 0 or high >= _LARGEST:
            raise MeshError(
                f"attribute {IDENTITY!r} holds a number twice, or one that is below 0 or over 2**53; it must "
                "tell all vertices apart. Rename it if it means something else"
            )
        return cls(max(given, high + 1))

    @property
    def births(self) -> AnyArray:
        return np.concatenate([_NO_BIRTHS, *self._records])

    def begin(self) -> None:
        """Start a new frame without births."""
        self._records.clear()

    def enter(self, identities: Floats, parents: Indices) -> None:
        """Number the last vertices of a surface, which are new.

        identities  (V,) of the whole surface, to be written into
        parents     (N, 2) the parents of each of the last N vertices, which may be among these N
        """
        first, more = len(identities) - len(parents), self.given + len(parents)
        identities[first:] = np.arange(self.given, more)
        self._records.append(
            np.column_stack([identities[first:], identities[parents]]).astype(np.int64).reshape(-1, 3)
        )
        self.given = more


@dataclass(frozen=True, eq=False)
class Ancestry:
    """A sparse matrix (V, U) with the shares of earlier vertices in the present ones, row after row.

    heirs      int64 (K,) present vertices, ascending
    ancestors  int64 (K,) earlier vertices, ascending for each heir
    weights    float64 (K,) above 0; those of an heir add up to 1
    """

    heirs: AnyArray
    ancestors: AnyArray
    weights: Floats

    @property
    def survives(self) -> AnyArray:
        """(V,) flags of the vertices that existed earlier; a vertex born since has at least two ancestors."""
        return np.bincount(self.heirs) == 1

    def mixed(self, values: AnyArray) -> Floats:
        """Return weighted means (V, …) of earlier values (U, …); a survivor keeps its own."""
        flat = np.asarray(values, np.float64).reshape(len(values), -1)
        mixed = np.empty((len(self.survives), flat.shape[1]))
        for k, column in enumerate(flat.T):
            mixed[:, k] = np.bincount(self.heirs, self.weights * column[self.ancestors])
        return mixed.reshape(-1, *np.shape(values)[1:])


def ancestry(now: AnyArray, then: AnyArray, births: AnyArray) -> Ancestry:
    """Return how the present vertices descend from earlier ones: each birth is the mean of its two parents.

    now     (V,) the attribute `identity` of the later surface
    then    (U,) that of the earlier one
    births  (N, 3) the records of all births after `then`, up to `now`, in order; earlier ones are ignored

    Weights are sums of powers of one half, exact over fifty generations. A survivor is its own only ancestor,
    even where a collapse has moved it to the middle of its edge.

    Raises UsageError where the births are out of order, or those of a vertex are missing.
    """
    if not (np.diff(births[:, 0]) > 0).all():
        raise UsageError("births are not in order; give those of all frames in between, one after the other")
    heirs, names, weights = np.arange(len(now)), np.asarray(now, np.int64), np.ones(len(now))
    by_name = np.argsort(then)
    settled = [(heirs[:0], by_name[:0], weights[:0])]
    while len(heirs):
        place = _index_of(names, then[by_name])
        old = place >= 0
        settled.append((heirs[old], by_name[place[old]], weights[old]))
        heirs, names, weights = heirs[~old], names[~old], weights[~old]
        birth = _index_of(names, births[:, 0])
        if (birth < 0).any():
            raise UsageError(
                f"vertex {names[birth < 0][0]} is neither of the earlier surface nor among the births; give "
                "those of all frames in between"
            )
        heirs, weights = np.tile(heirs, 2), np.tile(0.5 * weights, 2)
        heirs, names, weights = _merged(heirs, births[birth, 1:].T.reshape(-1), weights)
    heirs, ancestors, weights = (np.concatenate(part) for part in zip(*settled, strict=True))
    return Ancestry(*_merged(heirs, ancestors, weights))


def _index_of(wanted: AnyArray, ascending: AnyArray) -> AnyArray:
    """Return the index (N,) of each wanted number in an ascending row; -1 if it is missing."""
    place = np.searchsorted(ascending, wanted)
    exists = place < len(ascending)
    exists[exists] = ascending[place[exists]] == wanted[exists]
    return np.where(exists, place, -1)


def _merged(heirs: AnyArray, names: AnyArray, weights: Floats) -> tuple[AnyArray, AnyArray, Floats]:
    """Return each pair of an heir and a name once, in order, with the sum of its weights."""
    order = np.lexsort((names, heirs))
    heirs, names, weights = heirs[order], names[order], weights[order]
    begins = np.flatnonzero(np.append(True, np.diff(heirs) | np.diff(names))[: len(heirs)])
    return heirs[begins], names[begins], np.add.reduceat(weights, begins) if len(begins) else weights
