"""Paint: what a subject has on its faces, as texture coordinates, and of models colours and materials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray


def material_weight(number: int) -> str:
    """Return the name of the vertex attribute (V, 1) that is 1 on one of a model's materials, 0 elsewhere."""
    return f"material_{number}"


@dataclass(frozen=True, eq=False)
class PaintedFaces:
    """The paint of F faces.

    COLOURS      name of the vertex attribute (V, 3) with the vertex colours of a model

    coordinates  float64 (F, 3, 2) of their corners: 0 to 1 to the right and upwards in a texture, which
                 repeats beyond
    charts       int64 (F,): corners of one vertex in faces of the same chart are painted alike
    materials    int64 (F,): numbers of the materials of the model
    colours      linear Rec.709 reflectances (F, 3, 3) of their corners, or None where the model has none
    """

    COLOURS: ClassVar[str] = "vertex_colours"

    coordinates: NDArray[np.float64]
    charts: NDArray[np.int64]
    materials: NDArray[np.int64]
    colours: NDArray[np.float32] | None = None

    def of_faces(self, which: NDArray[np.bool_]) -> PaintedFaces:
        """Return the paint of the faces where `which` (F,) is True."""
        colours = None if self.colours is None else self.colours[which]
        return PaintedFaces(self.coordinates[which], self.charts[which], self.materials[which], colours)

    def attributes(self, corners: NDArray[np.integer]) -> dict[str, NDArray[np.float32]]:
        """Return the attributes of vertices that are these corners (V,), from 0 to 3F."""
        materials = self.materials[corners // 3]
        numbers = range(1, int(self.materials.max(initial=0)) + 1)
        weights = {material_weight(n): (materials == n).astype(np.float32)[:, None] for n in numbers}
        if self.colours is None:
            return weights
        return {**weights, self.COLOURS: self.colours.reshape(-1, 3)[corners]}

    def near_origin(self) -> NDArray[np.float64]:
        """Return the coordinates, each chart moved by whole textures to begin in the first one.

        Renderers hold coordinates in single precision, and textures repeat.
        """
        low = np.full((int(self.charts.max(initial=0)) + 1, 2), np.inf)
        np.minimum.at(low, self.charts, self.coordinates.min(axis=1))
        return self.coordinates - np.floor(low + 1e-6)[self.charts][:, None]

    @property
    def groups(self) -> NDArray[np.int64]:
        """(F, 3): the charts of the corners."""
        return np.repeat(self.charts[:, None], 3, axis=1)
