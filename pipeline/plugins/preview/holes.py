"""Holes of painted models in previews: faces at their borders are cut into pieces, and some left out."""

from __future__ import annotations

import numpy as np

from flowsculpt.api.materials import Material, PaintedFaces, Surface
from flowsculpt.api.meshes import Floats


def _pieces(across: int) -> Floats:
    """Return a triangle cut into smaller ones: barycentric coordinates (across², 3, 3) of their corners."""
    steps = range(across)
    upright = [((i, j), (i + 1, j), (i, j + 1)) for i in steps for j in steps if i + j < across]
    turned = [((i + 1, j + 1), (i, j + 1), (i + 1, j)) for i in steps for j in steps if i + j < across - 1]
    second, third = np.moveaxis(np.array(upright + turned) / across, 2, 0)
    return np.stack([1.0 - second - third, second, third], axis=2)


PIECES = _pieces(6)
"""The pieces of a face at the border of a hole."""

_THRESHOLDS = (np.arange(len(PIECES)) * 25 % len(PIECES) + 0.5) / len(PIECES)
"""The fraction from which on each piece is there: all pieces in turn, spread over the face."""


def without_holes(surface: Surface, look: Material, paint: PaintedFaces) -> Surface:
    """Return the pieces of a surface that are there: faces at the borders of holes are cut into PIECES.

    Of a fraction so many pieces are there.
    """
    middles = np.einsum("pc,fcx->fpx", PIECES.mean(axis=1), paint.coordinates)
    is_there: np.ndarray = np.ones(middles.shape[:2], bool)
    for number, part in enumerate(look.parts_by_number):
        which = paint.materials == number
        if part.opacity is not None and which.any():
            across, up = np.moveaxis(middles[which], 2, 0)
            is_there[which] = part.opacity.fractions_at(across, up) > _THRESHOLDS
    whole = is_there.all(axis=1)
    face, piece = np.nonzero(is_there & ~np.asarray(whole)[:, None])
    weights = PIECES[piece]

    def cut(of_corners: np.ndarray) -> np.ndarray:
        """Return the values (K, 3, …) at the corners of pieces, of those of faces (F, 3, …)."""
        return np.einsum("kic,kcx->kix", weights, of_corners[face]).astype(of_corners.dtype)

    def with_pieces(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, cut(values[surface.faces]).reshape(-1, values.shape[1])])

    pieces = np.arange(3 * len(face), dtype=np.int32).reshape(-1, 3) + len(surface.vertices)
    of_pieces = PaintedFaces(
        np.concatenate([paint.coordinates[whole], cut(paint.coordinates)]),
        np.concatenate([paint.charts[whole], paint.charts[face]]),
        np.concatenate([paint.materials[whole], paint.materials[face]]),
        None if paint.colours is None else np.concatenate([paint.colours[whole], cut(paint.colours)]),
    )
    return Surface(
        with_pieces(surface.vertices),
        with_pieces(surface.normals),
        np.concatenate([surface.faces[whole], pieces]),
        {name: with_pieces(values) for name, values in surface.attributes.items()},
        None if surface.rest is None else with_pieces(surface.rest),
        paint=of_pieces,
    )
