"""The contract of plug-ins for resamplers of polygons."""

from __future__ import annotations

from abc import ABC, abstractmethod

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh.meshes import PolygonMesh
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
