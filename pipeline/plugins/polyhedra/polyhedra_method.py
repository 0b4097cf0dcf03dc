"""The method `polyhedra` of resampling: its settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from flowsculpt import PolygonMesh, Thresholds
from flowsculpt.api import PolygonMethod, PolygonResampler
from flowsculpt.api.shots import one_of


class Polyhedra(PolygonMethod):
    """Slices faces of any number of sides by planes."""

    cutting: Annotated[str, one_of(("slice", "recurse"), "way to cut")] = Field(
        "slice", description="of polyhedra: all parallel cuts at once, or halves again and again"
    )
    collapse: Annotated[str, one_of(("edges", "areas"), "thing to collapse")] = Field(
        "edges", description="of polyhedra: short edges, or small faces"
    )

    def begin(self, mesh: PolygonMesh, thresholds: Thresholds) -> PolygonResampler:
        from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler

        return PolyhedralResampler(mesh, thresholds, **self._settings)

    def resume(self, state: Mapping[str, np.ndarray], thresholds: Thresholds) -> PolygonResampler:
        from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler

        return PolyhedralResampler.from_state(state, thresholds, **self._settings)

    @property
    def _settings(self) -> dict[str, Any]:
        return self.model_dump()
