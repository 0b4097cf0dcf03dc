"""Texture projection: texture coordinates from rest positions, so that textures move with the material.

Every corner of a triangle gets its coordinates from its rest position. Where one vertex needs two, at the
seam of a cylindrical texture or where the sides of a box meet, the surface is split.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Triple
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.render_camera import unit
from flowsculpt.render.scene.surface import Surface

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

MODEL = "model"
PROJECTIONS = ("planar", "box", "cylindrical", "spherical", MODEL)

_WRAPPED = ("cylindrical", "spherical")


@dataclass(frozen=True)
class TextureProjection:
    """The projection of textures onto the undeformed subject. Textures repeat.

    kind     "planar" (like a slide, along the axis), "box" (along x, y or z, whichever a triangle faces
             most), "cylindrical" (around the axis), "spherical" (around it, from pole to pole), "model" (by
             the subject's own texture coordinates)
    axis     planar: the direction the texture faces; cylindrical and spherical: the axis of revolution
    centre   scene point at the middle of the texture, or on the axis
    scale    scene units: width of a planar or box texture, height of a cylindrical one
    repeats  copies of a cylindrical or spherical texture around the axis
    turn     radians: anticlockwise in the texture's plane, or about the axis
    offset   shift to the right and up, in widths and heights of the texture

    keeps_place  True where a texture shows something else beyond its sides than itself again, so that
                 coordinates of "model" must not be moved by whole textures
    """

    kind: str = "box"
    axis: Triple | None = None
    centre: Triple = (0.0, 0.0, 0.0)
    scale: float = 2.0
    repeats: int = 1
    turn: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    keeps_place: bool = field(default=False, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        if self.kind not in PROJECTIONS:
            raise BadInputError(f"projection is {self.kind!r}; it can be {', '.join(PROJECTIONS)}")
        if not self.scale > 0.0 or self.repeats < 1 or (self.axis and math.hypot(*self.axis) < 1e-12):
            raise BadInputError(
                f"projection has scale {self.scale}, {self.repeats} repeats and axis {self.axis}; a scale is "
                "above 0, repeats are 1 or more, and an axis must not be zero"
            )

    @property
    def keeps_shape(self) -> bool:
        """True if the height of a texture follows from its width and its pixels."""
        return self.kind not in (*_WRAPPED, MODEL)

    def coordinates(
        self, points: Floats, faces: NDArray[np.int32], paint: PaintedFaces | None = None
    ) -> tuple[Floats, Counts]:
        """Return texture coordinates (F, 3, 2) of the corners of faces (F, 3), and group numbers (F, 3).

        Coordinates go right and up from the texture's middle, in widths of the texture; cylindrical and
        spherical ones in turns and heights. Corners of one vertex with the same group have the same
        coordinates.

        paint  what the subject has on the faces. Raises BadInputError where it is None and needed
        """
        if self.kind == MODEL:
            if paint is None:
                raise BadInputError(
                    "look takes the texture coordinates of the subject, which has none; take a solid, "
                    "or a model with paint: on"
                )
            placed = paint.coordinates if self.keeps_place else paint.near_origin()
            return placed - 0.5, paint.groups
        corners = (np.asarray(points, dtype=np.float64) - self.centre)[faces]
        if self.kind in _WRAPPED:
            return self._wrap(corners)
        sides = _sides(corners) if self.kind == "box" else np.zeros(len(faces), dtype=np.int64)
        frames = np.array([_facing(axis) for axis in _BOX] if self.kind == "box" else [_facing(self._axis())])
        c, s = math.cos(self.turn), math.sin(self.turn)
        turned = np.array([[c, s], [-s, c]]) @ frames / self.scale
        return np.einsum("fcx,fdx->fcd", corners, turned[sides]), np.repeat(sides[:, None], 3, axis=1)

    def _wrap(self, corners: Floats) -> tuple[Floats, Counts]:
        axis = np.array(self._axis())
        front = np.array([0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [0.0, -1.0, 0.0])
        front = unit(front - (front @ axis) * axis)
        height, ahead, right = corners @ axis, corners @ front, corners @ np.cross(axis, front)
        radius = np.hypot(ahead, right)
        across = (np.arctan2(right, ahead) - self.turn) / (2.0 * math.pi)
        across, shift = _unwrap(across - np.round(across), radius)
        up = height / self.scale
        if self.kind == "spherical":
            up = np.arctan2(height, radius) / math.pi * self.repeats
        return np.stack([across * self.repeats, up], axis=2), shift

    def _axis(self) -> Triple:
        """Return the unit axis; by default planar textures face the front, others stand upright."""
        axis = self.axis or ((0.0, 0.0, 1.0) if self.kind == "planar" else (0.0, 1.0, 0.0))
        x, y, z = unit(np.array(axis)).tolist()
        return x, y, z


_BOX = tuple((s * x, s * y, s * z) for x, y, z in np.eye(3).tolist() for s in (1.0, -1.0))
"""Directions that the sides of a box face."""


def project_texture(
    surface: Surface, points: Floats, projection: TextureProjection
) -> tuple[Surface, Floats]:
    """Return the surface, split where a vertex needs two texture coordinates, and those of its vertices (V,
    2).

    points  (V, 3), rest positions of its vertices
    """
    coordinates, groups = projection.coordinates(points, surface.faces, surface.paint)
    code = surface.faces.astype(np.int64) * (int(groups.max(initial=0)) + 1) + groups
    _, first, corner = np.unique(code, return_index=True, return_inverse=True)
    source = surface.faces.reshape(-1)[first]
    split = surface.with_copied_vertices(source, corner.reshape(-1, 3).astype(np.int32))
    if surface.paint is not None:
        split = replace(split, attributes={**split.attributes, **surface.paint.attributes(first)})
    return split, coordinates.reshape(-1, 2)[first]


def _unwrap(turns: Floats, radius: Floats) -> tuple[Floats, Counts]:
    """Return turns (F, 3) that do not jump within a face, and groups (F, 3): 0, or 1 beyond half a turn.

    A corner on the axis takes the mean of the others, and is a group of its own.

    turns   of the corners of faces around an axis, −0.5 to 0.5
    radius  (F, 3), their distances from the axis
    """
    seam = np.ptp(turns, axis=1) > 0.5
    shift = (seam[:, None] & (turns < 0.0)).astype(np.int64)
    turns = turns + shift
    pole = radius <= 1e-6 * max(float(radius.max(initial=0.0)), 1e-12)  # no direction of its own
    others = np.where(pole, 0.0, turns).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
    turns = np.where(pole, others[:, None], turns)
    return turns, np.where(pole, 2 + np.arange(len(turns))[:, None], shift)


def turns_around(right: Floats, ahead: Floats, faces: NDArray[np.int32]) -> tuple[Floats, Counts]:
    """Return the turns (F, 3) of corners of faces around an axis, 0.5 ahead, and charts (F,).

    In a face that the axis goes through, the corner nearest to it is taken to be on it.

    right, ahead  coordinates (V,) of vertices across the axis
    """
    turns, radius = np.arctan2(right, ahead)[faces] / (2.0 * math.pi), np.hypot(right, ahead)[faces]
    around = np.flatnonzero(np.round(turns - np.roll(turns, 1, axis=1)).sum(axis=1))
    radius[around, radius[around].argmin(axis=1)] = 0.0
    turns, groups = _unwrap(turns, radius)
    return turns + 0.5, groups.max(axis=1)


def unfolded_box(
    size: Triple, points: Floats, faces: NDArray[np.int32], normals: Floats
) -> tuple[Floats, Counts]:
    """Return coordinates (F, 3, 2) of corners of faces on a box that is unfolded to a cross, and sides (F,).

    In a row from the left: left, front, right and back; the top above the front, the bottom below it.

    size     its extents; its middle is the origin
    points   (V, 3)
    normals  (F, 3) of the faces
    """
    x, y, z = size
    axis = np.abs(normals).argmax(axis=1)
    side = 2 * axis + (normals[np.arange(len(faces)), axis] < 0.0)
    right, up = np.zeros((2, 6, 3))
    right[range(6), (2, 2, 0, 0, 0, 0)] = (-1, 1, 1, 1, 1, -1)
    up[range(6), (1, 1, 2, 2, 1, 1)] = (1, 1, -1, 1, 1, 1)
    front, middle = z + 0.5 * x, z + 0.5 * y
    across = np.array([1.5 * z + x, 0.5 * z, front, front, front, 2.0 * z + 1.5 * x])
    upwards = np.array([middle, middle, 1.5 * z + y, 0.5 * z, middle, middle])
    places = np.einsum("fcx,dfx->fcd", points[faces], np.stack([right[side], up[side]]))
    places += np.stack([across, upwards], axis=1)[side][:, None]
    return places / (2.0 * (x + z), y + 2.0 * z), side


def _sides(corners: Floats) -> Counts:
    """Return which of _BOX (F,) triangles face most at rest."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.abs(normal).argmax(axis=1)
    return np.asarray(2 * along + (normal[np.arange(len(normal)), along] < 0.0), dtype=np.int64)


def _facing(axis: Triple) -> Floats:
    """Return right and up (2, 3) of a texture that faces along the axis."""
    look = np.array(axis)
    up = np.array([0.0, 1.0, 0.0] if abs(look[1]) < 0.9 else [0.0, 0.0, -1.0])
    right = unit(np.cross(up, look))
    return np.stack([right, np.cross(look, right)])
