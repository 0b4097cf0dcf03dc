"""Resamplers of polygons, which plug-ins add by the names of their methods."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Literal, cast

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh.meshes import PolygonMesh
from flowsculpt.pipeline.plugin import named, plugins
from flowsculpt.pipeline.resample.resample_pass import PolyhedralReport
from flowsculpt.pipeline.resample.thresholds import Thresholds

Cutting = Literal["slice", "recurse"]
Collapse = Literal["edges", "areas"]


class PolygonResampler(ABC):
    """A surface of polygons in flow: move `vertices`, then call `resample()`, frame after frame.

    thresholds  length limits and hard angle; may be replaced between frames
    """

    thresholds: Thresholds

    @abstractmethod
    def __init__(
        self,
        mesh: PolygonMesh,
        thresholds: Thresholds,
        cutting: Cutting = "slice",
        collapse: Collapse = "edges",
    ) -> None:
        """Begin with the first surface. Raises MeshError where it is not sound."""

    @property
    @abstractmethod
    def vertices(self) -> Points:
        """(V, 3) float64: write the moved positions into it. `resample` replaces the array."""

    @property
    @abstractmethod
    def mesh(self) -> PolygonMesh:
        """The surface as a value: vertices in the order of `vertices`."""

    @classmethod
    @abstractmethod
    def from_state(
        cls,
        state: Mapping[str, AnyArray],
        thresholds: Thresholds,
        cutting: Cutting = "slice",
        collapse: Collapse = "edges",
    ) -> PolygonResampler:
        """Resume with the same bits as without a stop. Raises UsageError where arrays are missing.

        state  vertices, offsets, corners, creases, and vertex attributes as `attribute.NAME`
        """

    @abstractmethod
    def resample(self) -> PolyhedralReport:
        """Bring edges and faces within their limits, in place. Raises FrameError where that cannot be."""


def polygon_resampler(method: str) -> type[PolygonResampler]:
    """Return the resampler of a method."""
    return cast("type[PolygonResampler]", named(plugins().resamplers[method]))
