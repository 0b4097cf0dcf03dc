"""What a frame shows: triangles with normals, split where they are to look sharp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError


@dataclass(frozen=True, eq=False)
class Surface:
    """What is rendered: vertices split at creases, with their normals.

    vertices    float32 (V, 3), scene units
    normals     float32 (V, 3), unit length
    faces       int32 (F, 3), counter-clockwise seen from outside
    attributes  by name, float32 (V, k)
    material    float32 (V, 3), where its points were before anything moved them; pigments need it
    edges       int32 (E, 2), those that a wireframe shows; all those of the faces where none are named
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    attributes: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    material: NDArray[np.float32] | None = None
    edges: NDArray[np.int32] | None = None

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(3,) and (3,): the least and the greatest coordinates. Column by column, which is ten times as fast
        as all together."""
        columns = self.vertices.T
        return np.array([each.min() for each in columns]), np.array([each.max() for each in columns])

    def check(self) -> None:
        """Raises BadInputError for what Mitsuba would render wrongly, or crash on, without a word."""
        count = len(self.vertices)
        if not count or not len(self.faces):
            raise BadInputError("the surface is empty; it needs at least one triangle")
        for name, array in (("vertices", self.vertices), ("normals", self.normals)):
            if array.shape != (count, 3):
                raise BadInputError(f"the surface's {name} have shape {array.shape}; not ({count}, 3)")
            if not np.isfinite(array).all():
                bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
                raise BadInputError(
                    f"the surface's {name} are not finite at vertex {bad[0]} and {len(bad) - 1} others; "
                    "the flow must keep them finite"
                )
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise BadInputError(f"the surface's faces have shape {self.faces.shape}; they must be (F, 3)")
        if self.faces.min() < 0 or self.faces.max() >= count:
            raise BadInputError(
                f"a face names vertex {int(self.faces.max())} or {int(self.faces.min())}; there are {count}"
            )
        if self.edges is not None and (
            self.edges.ndim != 2
            or self.edges.shape[1] != 2
            or ((self.edges < 0) | (self.edges >= count)).any()
        ):
            raise BadInputError(f"the surface's edges must be (E, 2), and name some of its {count} vertices")
        for name, array in self.attributes.items():
            if array.ndim != 2 or len(array) != count or not np.isfinite(array).all():
                raise BadInputError(f"attribute {name!r} must be finite and have shape ({count}, k)")
        if self.material is not None and (
            self.material.shape != (count, 3) or not np.isfinite(self.material).all()
        ):
            raise BadInputError(f"the surface's material must be finite and have shape ({count}, 3)")
