"""Layouts of copies: grids, rings, discs, spirals, and places on surfaces."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt import TriangleMesh, UsageError, read_mesh
from flowsculpt.api import CopyLayout, plural
from flowsculpt.api.meshes import (
    Floats,
    ModelFile,
)
from flowsculpt.api.shots import (
    Document,
    OneOfSeveral,
    ParseContext,
    Positive,
    Solid,
    Triple,
    one_of,
)

ORIGIN, UP = [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""The golden angle: places that it separates fill a disc evenly (Vogel, *A better way to construct the
sunflower head*, 1979)."""

STEPS = 20_000
"""Pieces of a spiral that its length is measured by."""

FACES = 4
"""Faces of a surface for each copy, at least: places are even then."""

_SOLIDS = [name for name in Solid.KINDS if name != "lattice"]

Places = tuple[Floats, Floats]


class Arrangement(Document):
    """A way to arrange copies."""

    @abstractmethod
    def arranged(self, count: int, seed: int) -> Places:
        """Return places (count, 3) and rotations (count, 3, 3)."""


class GridDocument(Arrangement):
    """Rows of copies along x, y and z, filled first along x, then along z, then upwards."""

    cells: Annotated[list[Annotated[int, Field(ge=1, le=5000)]], Field(min_length=3, max_length=3)] = Field(
        description="places along x, y and z"
    )
    spacing: Triple = Field(description="between the middles of neighbours along x, y and z (units)")
    centre: Triple = Field(ORIGIN, description="middle of the grid (units)")

    def arranged(self, count: int, seed: int) -> Places:
        nx, ny, nz = self.cells
        if count > (cells := nx * ny * nz):
            raise UsageError(f"the grid has {plural(cells, 'cell')}, and count is {count}. Add cells.")
        y, z, x = np.unravel_index(np.arange(count), (ny, nz, nx))
        steps = np.stack([x, y, z], axis=1) - 0.5 * (np.array(self.cells) - 1.0)
        return np.array(self.centre) + steps * np.array(self.spacing), np.tile(np.eye(3), (count, 1, 1))


class Around(Arrangement):
    """An arrangement around an axis."""

    centre: Triple = Field(ORIGIN, description="its middle (units)")
    axis: Triple = Field(UP, description="direction of its axis, where copies have their upright")

    @model_validator(mode="after")
    def _has_direction(self) -> Self:
        if not np.linalg.norm(self.axis) > 1e-9:
            raise ValueError("axis has no length; it is a direction. Write one such as [0, 1, 0].")
        return self

    def around(self, radius: Floats, angle: Floats, height: Floats) -> Places:
        """Return places (N, 3) and rotations (N, 3, 3), outwards along x, by cylindrical coordinates (N,)."""
        frame = frames(np.array([self.axis]), np.array([[1.0, 0.0, 0.0]]))[0]
        out = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
        up = np.broadcast_to(UP, out.shape)
        local = radius[:, None] * out + height[:, None] * up
        turns = np.stack([out, up, np.cross(out, up)], axis=2)
        return np.array(self.centre) + local @ frame.T, frame @ turns


class RingDocument(Around):
    """Copies on a circle, equally far apart, facing outwards."""

    radius: Positive = Field(description="of the circle (units)")

    def arranged(self, count: int, seed: int) -> Places:
        angle = 2.0 * math.pi * np.arange(count) / count
        return self.around(np.full(count, float(self.radius)), angle, np.zeros(count))


class DiscDocument(Around):
    """Copies in a disc, as seeds in the head of a sunflower, facing outwards."""

    radius: Positive = Field(description="of the disc (units)")
    height: float = Field(0.0, description="of its middle above its border; below 0 for a bowl (units)")

    def arranged(self, count: int, seed: int) -> Places:
        share = (np.arange(count) + 0.5) / count
        radius = self.radius * np.sqrt(share)
        return self.around(radius, GOLDEN * np.arange(float(count)), self.height * (0.5 - share))


class SpiralDocument(Around):
    """Copies along a spiral or a screw, equally far apart, facing outwards."""

    radius: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)] = Field(
        description="of its start and of its end (units)"
    )
    turns: Positive = Field(3.0, description="around the axis")
    height: float = Field(0.0, description="of its end above its start (units)")

    def arranged(self, count: int, seed: int) -> Places:
        share = np.linspace(0.0, 1.0, STEPS + 1)
        along, _ = self.around(*self._at(share))
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(along, axis=0), axis=1)))
        return self.around(*self._at(np.interp(np.linspace(0.0, length[-1], count), length, share)))

    def _at(self, share: Floats) -> tuple[Floats, Floats, Floats]:
        """Return radius, angle and height at shares (N,) of the turns."""
        start, end = self.radius
        return start + share * (end - start), 2.0 * math.pi * self.turns * share, (share - 0.5) * self.height


class SurfaceDocument(Arrangement):
    """Copies on the surface of a solid or a model, evenly by area, upright on it."""

    solid: Annotated[str, one_of(_SOLIDS, "solid that copies stand on")] | None = Field(
        None, description="its name; or model"
    )
    size: list[Positive] | None = Field(
        None, description="sides of the solid (units)", min_length=2, max_length=3
    )
    radius: Positive | None = Field(None, description="of the solid (units)")
    length: Positive | None = Field(None, description="of a rod (units)")
    tube_radius: Positive | None = Field(None, description="of the tube of a torus (units)")
    model: str | None = Field(
        None, description="an OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD beside the shot file"
    )
    scale: Positive = Field(1.0, description="factor on all coordinates")
    centre: Triple = Field(ORIGIN, description="position of its origin (units)")
    offset: float = Field(0.0, description="of the middles of copies outwards from the surface (units)")

    _mesh: TriangleMesh = PrivateAttr()
    _digests: tuple[str, ...] = PrivateAttr(())

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> Self:
        if (self.solid is None) == (self.model is None):
            raise ValueError("copies are on a solid or on a model. Write one, such as solid: torus.")
        given = self.model_dump(exclude_none=True, include={"size", "radius", "length", "tube_radius"})
        known = Solid.KINDS[self.solid].measures if self.solid else {}
        for name, value in given.items():
            if np.size(value) != np.size(known.get(name, ())):
                whose = f"the {self.solid or 'model'}"
                raise ValueError(f"{name} is not a measure of {whose}, or has other numbers. Leave it out.")
        if self.solid is not None:
            self._mesh = Solid.of(self.solid, given).build()
        elif self.model is not None:
            path = ParseContext.of(info).mesh(self.model)
            self._mesh = read_mesh(path)
            self._digests = (ModelFile(path).files().digest,)
        return self

    def digests(self) -> tuple[str, ...]:
        """Return the digest of the model's file."""
        return self._digests

    def arranged(self, count: int, seed: int) -> Places:
        mesh = refined(self._mesh, FACES * count)
        points, face = mesh.scattered(count, seed)
        normals = mesh.face_normals[face]
        places = np.array(self.centre) + self.scale * points + self.offset * normals
        return places, frames(normals, np.broadcast_to((1.0, 0.0, 0.0), normals.shape))


class OneLayout(CopyLayout, OneOfSeveral):
    """The places of copies: one arrangement, and the lean of the copies in it."""

    example = "{ring: {radius: 1}}"
    noun, several = "a layout", ("grid", "ring", "disc", "spiral", "surface")
    grid: GridDocument | None = Field(None, description="rows along x, y and z")
    ring: RingDocument | None = Field(None, description="a circle around an axis")
    disc: DiscDocument | None = Field(None, description="as seeds in a sunflower")
    spiral: SpiralDocument | None = Field(None, description="around an axis")
    surface: SurfaceDocument | None = Field(None, description="on a solid or a model")
    lean: Annotated[float, Field(ge=-3600, le=3600)] = Field(
        0.0, description="of copies, outwards, or along x (degrees)"
    )
    jitter: Triple = Field(
        ORIGIN, description="by how much places are moved by chance, at most, along x, y and z (units)"
    )

    def digests(self) -> tuple[str, ...]:
        return self.surface.digests() if self.surface else ()

    def places(self, count: int, seed: int) -> Places:
        arrangement: Any = getattr(self, self.named[0])
        places, turns = arrangement.arranged(count, seed)
        moves = np.array(self.jitter) * np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, (count, 3))
        lean = math.radians(1.0) * self.lean
        c, s = math.cos(lean), math.sin(lean)
        return places + moves, turns @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def frames(up: Floats, ahead: Floats) -> Floats:
    """Return rotations (N, 3, 3) that turn y to `up` (N, 3), and x as near to `ahead` (N, 3) as can be."""
    y = _unit(np.asarray(up, np.float64))
    along = np.abs((y * ahead).sum(axis=1)) > 0.999
    z = _unit(np.cross(np.where(along[:, None], (0.0, 0.0, -1.0), ahead), y))
    return np.stack([np.cross(y, z), y, z], axis=2)


def _unit(vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def refined(mesh: TriangleMesh, faces: int) -> TriangleMesh:
    """Return a mesh whose triangles are cut into four each until there are so many."""
    corners = mesh.vertices[mesh.faces]
    while len(corners) < faces:
        a, b, c = corners.swapaxes(0, 1)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)
    return TriangleMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
