"""Colours that change over a surface by one number at its vertices: a pigment's phase, or what is measured.

Faces interpolate the number, and a row of colours says what it looks like: `render.mitsuba.materials` shows
that row to Mitsuba; pictures without a path tracer look up the colours of vertices here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.scene.look import Look
from render.scene.surface import Surface

Floats = NDArray[np.float64]


def phases(surface: Surface, look: Look) -> Floats | None:
    """(V,): where in the row of its look's colours vertices lie; None for a look that has no such row.

    Raises BadInputError for a look that needs to know what the surface does not say.
    """
    if look.measure is not None:
        return look.measure.phases(surface)
    return None if look.pigment is None else look.pigment.phases(at_rest(surface, "has a pigment"))


def colours(surface: Surface, look: Look) -> Floats | None:
    """(V, 3): linear Rec.709 reflectances of vertices; None for a look of one colour. Raises as `phases`."""
    if look.picture is not None:
        return _of_picture(surface, look)
    found = phases(surface, look)
    if found is None:
        return None
    dye = look.measure or look.pigment
    assert dye is not None
    row = dye.row()
    inside = found % 1.0 if look.repeats else np.clip(found, 0.0, 1.0)
    return np.asarray(row[np.minimum((inside * len(row)).astype(int), len(row) - 1)], dtype=np.float64)


def _of_picture(surface: Surface, look: Look) -> Floats:
    """Those of the pixels at vertices; where one lies in two places, of one of these."""
    assert look.picture is not None
    points = at_rest(surface, "has a picture")
    alone = np.repeat(np.arange(len(points), dtype=np.int32)[:, None], 3, axis=1)
    faces = surface.faces if len(surface.faces) else alone
    corners, _ = look.projection.places(points, faces)
    place = np.zeros((len(points), 2))
    place[faces.reshape(-1)] = corners.reshape(-1, 2)
    pixels = look.picture.pixels()
    height, width = pixels.shape[:2]
    right, up = look.projection.offset
    across = place[:, 0] + 0.5 - right
    down = 0.5 + up - place[:, 1] * (width / height if look.projection.keeps_shape else 1.0)
    rows, columns = (
        np.minimum((place % 1.0 * count).astype(int), count - 1)
        for place, count in ((down, height), (across, width))
    )
    return np.asarray(pixels[rows, columns], dtype=np.float64)


def at_rest(surface: Surface, why: str) -> Floats:
    """(V, 3): where vertices were before anything moved them. why: what the look needs it for"""
    if surface.material is None:
        raise BadInputError(
            f"look {why}, and the surface does not say where its points were; give it material"
        )
    return np.asarray(surface.material, dtype=np.float64)
