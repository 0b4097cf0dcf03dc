"""What a closed surface holds, as a region."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, Vector, place_at
from pipeline.flow.closed_surface import ClosedSurface
from pipeline.flow.program import Instruction
from pipeline.flow.regions import Region


@dataclass(frozen=True)
class MeshRegion(Region):
    """All points within a closed surface, by their distance from it: exact, at any place and any falloff.

    surface  of a mesh; parts of it that reach into one another are one, shells within shells are hollows
    centre   where the mesh's origin is put
    scale    factor on the mesh
    """

    surface: ClosedSurface
    centre: Place = ORIGIN
    scale: Number = 1.0

    def closing(self, time: float) -> Instruction:
        """What stands for it in keys holds a digest of the surface in place of its address."""
        closing = super().closing(time)
        known = [*closing.numbers[:4], self.surface.digest, *closing.numbers[5:]]
        return closing._replace(identity=known, owner=self.surface.lookup)

    @property
    def _opcode(self) -> int:
        return op.CLOSE_MESH

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        address = float(self.surface.lookup.memory.ctypes.data)
        return (*place_at(self.centre, time), self._size(self.scale, "scale", time), address), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        scale, (_, low, high) = self._size(self.scale, "scale", time), self.surface.lookup
        rim, put = self.falloff_at(time), place_at(self.centre, time)
        x, y, z = (c + 0.5 * scale * (a + b) for c, a, b in zip(put, low, high, strict=True))
        u, v, w = (0.5 * scale * (b - a) + rim for a, b in zip(low, high, strict=True))
        return (x, y, z), (u, v, w)

    @property
    def name(self) -> str:
        return "mesh"
