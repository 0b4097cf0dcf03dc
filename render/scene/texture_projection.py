"""How pictures are laid on the undeformed sculpture, so that they move with the material.

Every corner of a triangle is given a place in the picture by where it was at rest. Where one vertex needs
two, at the seam of a picture that goes around, or where the sides of a box meet, the surface is split.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.scene.surface import Surface

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

PROJECTIONS = ("planar", "box", "cylindrical", "spherical")

_AROUND = ("cylindrical", "spherical")


@dataclass(frozen=True)
class Projection:
    """How pictures lie on the undeformed subject. They repeat.

    kind     "planar", as a slide throws them along the axis; "box", along x, y or z, whichever a triangle
             faces most; "cylindrical", around the axis; "spherical", around it and from pole to pole
    axis     towards whom a planar picture looks; of the other two, what they go around
    centre   where the middle of the picture lies, or the axis
    scale    scene units: how wide a planar picture or one of a box is, or how high a cylindrical one
    repeats  how often cylindrical and spherical pictures are seen on the way around
    turn     radians: anticlockwise in its plane, or about the axis
    offset   by which shares of itself a picture lies further to the right and up
    """

    kind: str = "box"
    axis: Triple | None = None
    centre: Triple = (0.0, 0.0, 0.0)
    scale: float = 2.0
    repeats: int = 1
    turn: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.kind not in PROJECTIONS:
            raise BadInputError(f"projection is {self.kind!r}; it can be {', '.join(PROJECTIONS)}")
        if not self.scale > 0.0 or self.repeats < 1 or (self.axis and math.hypot(*self.axis) < 1e-12):
            raise BadInputError(
                f"projection has scale {self.scale}, {self.repeats} repeats and axis {self.axis}; a scale is "
                "above 0, repeats are 1 or more, and an axis has a length"
            )

    @property
    def keeps_shape(self) -> bool:
        """Whether a picture is as high as its width and its pixels make it."""
        return self.kind not in _AROUND

    def places(self, points: Floats, faces: NDArray[np.int32]) -> tuple[Floats, Counts]:
        """(F, 3, 2): where the corners of faces (F, 3) lie, from the picture's middle, right and up.

        In widths of the picture, but around something in shares of it. Also (F, 3) whole numbers: corners of
        one vertex that have the same number have the same place.
        """
        corners = (np.asarray(points, dtype=np.float64) - self.centre)[faces]
        if self.kind in _AROUND:
            return self._around(corners)
        sides = _sides(corners) if self.kind == "box" else np.zeros(len(faces), dtype=np.int64)
        frames = np.array([_facing(axis) for axis in _BOX] if self.kind == "box" else [_facing(self._axis())])
        c, s = math.cos(self.turn), math.sin(self.turn)
        turned = np.array([[c, s], [-s, c]]) @ frames / self.scale
        return np.einsum("fcx,fdx->fcd", corners, turned[sides]), np.repeat(sides[:, None], 3, axis=1)

    def _around(self, corners: Floats) -> tuple[Floats, Counts]:
        axis = np.array(self._axis())
        front = np.array([0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [0.0, -1.0, 0.0])
        front = _unit(front - (front @ axis) * axis)
        height, ahead, right = corners @ axis, corners @ front, corners @ np.cross(axis, front)
        out = np.hypot(ahead, right)
        across = (np.arctan2(right, ahead) - self.turn) / (2.0 * math.pi)
        across -= np.round(across)
        seam = np.ptp(across, axis=1) > 0.5
        shift = (seam[:, None] & (across < 0.0)).astype(np.int64)
        across += shift
        pole = out <= 1e-6 * max(float(out.max(initial=0.0)), 1e-12)  # of no direction: that of the others
        others = np.where(pole, 0.0, across).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
        across = np.where(pole, others[:, None], across)
        shift = np.where(pole, 2 + np.arange(len(corners))[:, None], shift)
        up = height / self.scale
        if self.kind == "spherical":
            up = np.arctan2(height, out) / math.pi * self.repeats
        return np.stack([across * self.repeats, up], axis=2), shift

    def _axis(self) -> Triple:
        """Unit length; by default planar pictures look to the front, and others stand upright."""
        axis = self.axis or ((0.0, 0.0, 1.0) if self.kind == "planar" else (0.0, 1.0, 0.0))
        x, y, z = _unit(np.array(axis)).tolist()
        return x, y, z


_BOX = tuple((s * x, s * y, s * z) for x, y, z in np.eye(3).tolist() for s in (1.0, -1.0))
"""Where the sides of a box look."""


def unwrapped(surface: Surface, points: Floats, projection: Projection) -> tuple[Surface, Floats]:
    """The surface, split where a vertex lies in two places of the picture, and the place (V, 2) of each.

    points: (V, 3), where its vertices were at rest
    """
    places, groups = projection.places(points, surface.faces)
    code = surface.faces.astype(np.int64) * (int(groups.max(initial=0)) + 1) + groups
    _, first, corner = np.unique(code, return_index=True, return_inverse=True)
    source = surface.faces.reshape(-1)[first]
    split = replace(
        surface,
        vertices=surface.vertices[source],
        normals=surface.normals[source],
        faces=corner.reshape(-1, 3).astype(np.int32),
        attributes={name: values[source] for name, values in surface.attributes.items()},
        material=None if surface.material is None else surface.material[source],
        edges=None,
    )
    return split, places.reshape(-1, 2)[first]


def _sides(corners: Floats) -> Counts:
    """(F,): which of _BOX triangles face most at rest."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.abs(normal).argmax(axis=1)
    return np.asarray(2 * along + (normal[np.arange(len(normal)), along] < 0.0), dtype=np.int64)


def _facing(axis: Triple) -> Floats:
    """(2, 3): right and up of a picture that looks along the axis to whom stands there."""
    look = np.array(axis)
    up = np.array([0.0, 1.0, 0.0] if abs(look[1]) < 0.9 else [0.0, 0.0, -1.0])
    right = _unit(np.cross(up, look))
    return np.stack([right, np.cross(look, right)])


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
