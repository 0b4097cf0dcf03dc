"""Who is who on a surface whose vertices come and go: a number for each that is never given twice."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.errors import MeshError
from pipeline.mesh.triangles import TriangleMesh

IDENTITY = "identity"
"""The vertex attribute (V,), int64, that tells the vertices of a film apart."""

_MOST = 1 << 53  # attributes are carried as float64, which counts no further
_NOBODY = np.empty((0, 3), np.int64)


def with_identities(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh with its vertices numbered from 0 on: where a film begins."""
    return mesh.with_attributes(**{IDENTITY: np.arange(len(mesh.vertices), dtype=np.int64)})


class Register:
    """The births of one frame, and how many vertices there have ever been.

    given   how many numbers have been given: the next vertex gets this one
    births  int64 (N, 3), in order of birth: a vertex's number and its parents'; those that died again
            within the frame are among them
    """

    def __init__(self, given: int) -> None:
        self.given = given
        self._pages: list[AnyArray] = []

    @classmethod
    def of(cls, mesh: TriangleMesh, given: int = 0) -> Register | None:
        """The register of a mesh of which so many numbers have been given; None where it has no identities.

        Raises MeshError where these are not different numbers, int64 and from 0 on.
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
        if (np.diff(ordered) == 0).any() or low < 0 or high >= _MOST:
            raise MeshError(
                f"attribute {IDENTITY!r} holds a number twice, or one that is below 0 or over 2**53; it must "
                "tell all vertices apart. Rename it if it means something else"
            )
        return cls(max(given, high + 1))

    @property
    def births(self) -> AnyArray:
        return np.concatenate([_NOBODY, *self._pages])

    def begin(self) -> None:
        """A new frame, in which nobody has been born yet."""
        self._pages.clear()

    def enter(self, identities: Floats, parents: Indices) -> None:
        """Number the last vertices of a surface, which have just been born.

        identities  (V,) of the whole surface, to be written into
        parents     (N, 2) the two vertices that each of the last N was born of, earlier ones of these N too
        """
        first, more = len(identities) - len(parents), self.given + len(parents)
        identities[first:] = np.arange(self.given, more)
        self._pages.append(
            np.column_stack([identities[first:], identities[parents]]).astype(np.int64).reshape(-1, 3)
        )
        self.given = more
