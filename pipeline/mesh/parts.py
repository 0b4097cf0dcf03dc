"""Parts of a surface that no edge joins, and the small ones among them that decide its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.mesh.face_soup import components
from pipeline.mesh.polygon_mesh import PolygonMesh

SMALL = 0.01
"""Part of the surface's area below which a part is small."""

LARGER = 1.1
"""Size of the whole surface over that of its other parts from which on small parts decide it."""


@dataclass(frozen=True)
class SmallParts:
    """Small parts that make a surface larger than its other parts are.

    parts     number of all parts
    small     number of small parts
    share     fraction of the faces that the largest part has
    factor    size with the small parts over size without them
    farthest  (3,) the vertex of a small part that is farthest from the middle of the others
    """

    parts: int
    small: int
    share: float
    factor: float
    farthest: Points

    def __str__(self) -> str:
        at = ", ".join(f"{x:.4g}" for x in self.farthest)
        make, them = (" each, make", "them") if self.small > 1 else (", makes", "it")
        return (
            f"{self.parts} parts; the largest has {100.0 * self.share:.3g}% of the faces. {self.small} "
            f"of them, with less than {SMALL:.0%} of the area{make} the model "
            f"{self.factor:.3g} times as large; the farthest reaches ({at}) in the file. Delete {them} in a "
            f"modelling program, or leave {them} if the model is meant to have {them}."
        )


def find_small_parts(mesh: PolygonMesh) -> SmallParts | None:
    """Return the small parts that decide the size of a mesh; None if it is as large without them."""
    part = components(len(mesh.vertices), mesh.corners, mesh.heads)
    of_face = part[mesh.corners[mesh.offsets[:-1]]]
    area = np.bincount(of_face, mesh.areas, len(part))
    faces = np.bincount(of_face, minlength=len(part))
    is_small = (faces > 0) & (area < SMALL * area.sum())
    if not is_small.any() or is_small[faces > 0].all():
        return None
    small, large = mesh.vertices[is_small[part]], mesh.vertices[~is_small[part]]
    factor = _size(mesh.vertices) / max(_size(large), 1e-300)
    if factor < LARGER:
        return None
    middle = 0.5 * (large.min(axis=0) + large.max(axis=0))
    farthest = small[np.linalg.norm(small - middle, axis=1).argmax()]
    share = float(faces.max()) / len(mesh)
    return SmallParts(int((faces > 0).sum()), int(is_small.sum()), share, factor, farthest)


def _size(points: AnyArray) -> float:
    return float(np.ptp(points, axis=0).max())
