"""The two texture coordinates of a surface's vertices: what its material and its matte are told by.

The first is the phase of a dye, or the first coordinate of a picture that is laid on. The second is 1 on
the subject and 0 elsewhere, so that its mean over a pixel is the matte; a little beside 1 stands the second
coordinate of the picture, so little that the matte does not show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.vertex_colours import at_rest, phases
from render.scene.look import Look
from render.scene.surface import Surface
from render.scene.texture_projection import unwrapped

Rows = NDArray[np.float64]

SUBJECT, SURROUNDINGS = 1.0, 0.0

_FINE = 2.0**-10
"""How much of the second coordinate the picture's may take. A float32 beside 1 has 8000 steps."""

_FINER = 2.0**-8
"""The same for pictures from files, above 1 alone: 32000 steps, and a matte cut at 1 is within 0.2%."""


@dataclass(frozen=True, eq=False)
class Marks:
    """Texture coordinates (V, 2); and the factor on the second, and what is then added, that make it the
    picture's again.

    The factor is a whole number, so that pictures that repeat do so in step with what stands before the
    point.
    """

    values: Rows
    factor: float = 1.0
    added: float = 0.0


def marked(surface: Surface, look: Look) -> tuple[Surface, Marks]:
    """The subject, split where a picture needs it, and the marks of its vertices.

    Raises BadInputError for a look that needs to know where points were, and cannot.
    """
    if look.model == "brushed":
        return surface, laid_on(at_rest(surface, "is brushed"), _across(look))
    if look.has_pictures:
        return _with_pictures(surface, look)
    found = phases(surface, look)
    first = np.zeros(len(surface.vertices)) if found is None else found
    return surface, Marks(np.stack([first, np.full(len(first), SUBJECT)], axis=1))


def laid_on(points: Rows, axes: Rows) -> Marks:
    """Pictures across the undeformed subject. axes: (2, 3), of a length of 1 / that of the picture's sides"""
    along, across = (points.astype(np.float64) @ axes.T).T
    reach = max(float(np.abs(across).max(initial=0.0)), 1.0)
    factor = 2.0 ** math.ceil(math.log2(reach)) / _FINE
    return Marks(np.stack([along, SUBJECT + across / factor], axis=1), factor)


def _with_pictures(surface: Surface, look: Look) -> tuple[Surface, Marks]:
    """Pictures from files, as the look lays them on."""
    split, places = unwrapped(surface, at_rest(surface, "has a picture"), look.projection)
    right, up = places.T
    reach = 2.0 ** math.ceil(math.log2(max(float(np.abs(up).max(initial=0.0)), 1.0)))
    factor = 2.0 * reach / _FINER
    values = np.stack([right, SUBJECT + (up + reach) / factor], axis=1)
    return split, Marks(values, factor, -factor * SUBJECT - reach)


def _across(look: Look) -> Rows:
    """Scratches lie where the second coordinate stays the same; the first only has to go along them."""
    grain = np.array(look.grain) / math.hypot(*look.grain)
    other = np.eye(3)[int(np.abs(grain).argmin())]
    return np.stack([np.cross(grain, other), grain])
