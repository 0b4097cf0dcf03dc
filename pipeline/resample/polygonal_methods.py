"""The contracts of plug-ins for methods of resampling polygons, which shots name as `method`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh.meshes import PolygonMesh
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.resample.resample_pass import PolygonReport
from flowsculpt.pipeline.resample.thresholds import Thresholds


class PolygonResampler(ABC):
    """A surface of polygons in flow: move `vertices`, then call `resample()`, frame after frame.

    thresholds  length limits and hard angle; may be replaced between frames
    """

    thresholds: Thresholds

    @property
    @abstractmethod
    def vertices(self) -> Points:
        """(V, 3) float64: write the moved positions into it. `resample` replaces the array."""

    @property
    @abstractmethod
    def mesh(self) -> PolygonMesh:
        """The surface as a value: vertices in the order of `vertices`."""

    @abstractmethod
    def resample(self) -> PolygonReport:
        """Bring edges and faces within their limits, in place. Raises FrameError where that cannot be."""


class PolygonMethod(BaseModel):
    """A method of resampling: its settings, and the resamplers that have them.

    Its fields are settings in `resample` of shots, next to `method`, and their names and values decide keys.
    Each has a default, a description, and a name that no other setting has.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    @abstractmethod
    def begin(self, mesh: PolygonMesh, thresholds: Thresholds) -> PolygonResampler:
        """Begin with the first surface. Raises MeshError where it is not sound."""

    @abstractmethod
    def resume(self, state: Mapping[str, AnyArray], thresholds: Thresholds) -> PolygonResampler:
        """Resume with the same bits as without a stop. Raises UsageError where arrays are missing.

        state  vertices, offsets, corners, creases, and vertex attributes as `attribute.NAME`
        """


def polygon_methods() -> dict[str, type[PolygonMethod]]:
    """Return the methods of plug-ins by their names."""
    methods: dict[str, type[PolygonMethod]] = plugins().classes("resamplers", PolygonMethod)
    return methods


def polygon_method(name: str, settings: Iterable[tuple[str, Any]] = ()) -> PolygonMethod:
    """Return a method with settings."""
    return polygon_methods()[name](**dict(settings))
