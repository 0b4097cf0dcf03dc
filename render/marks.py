"""The two texture coordinates of a surface's vertices: what its material and its matte are told by.

The first is the phase of a pigment, or the first coordinate of a picture that is laid on. The second is 1 on
the subject and 0 elsewhere, so that its mean over a pixel is the matte; a little beside 1 stands the second
coordinate of the picture, so little that the matte does not show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.errors import BadInputError
from render.look import Look
from render.surface import Surface

Rows = NDArray[np.float64]

SUBJECT, SURROUNDINGS = 1.0, 0.0

_FINE = 2.0**-10
"""How much of the second coordinate the picture's may take. A float32 beside 1 has 8000 steps."""


@dataclass(frozen=True, eq=False)
class Marks:
    """Texture coordinates (V, 2); and the factor on the second that makes it the picture's again.

    It is a whole number, so that pictures that repeat do so in step with what stands before the point.
    """

    values: Rows
    factor: float = 1.0


def marks(surface: Surface, look: Look) -> Marks:
    """Of the subject. Raises BadInputError for a look that needs to know where points were, and cannot."""
    if look.model == "brushed":
        return laid_on(_at_rest(surface, "is brushed"), _across(look))
    if look.pigment is None:
        phases = np.zeros(len(surface.vertices))
    else:
        phases = look.pigment.phases(_at_rest(surface, "has a pigment"))
    return Marks(np.stack([phases, np.full(len(phases), SUBJECT)], axis=1))


def laid_on(points: Rows, axes: Rows) -> Marks:
    """Pictures across the undeformed subject. axes: (2, 3), of a length of 1 / that of the picture's sides"""
    along, across = (points.astype(np.float64) @ axes.T).T
    reach = max(float(np.abs(across).max(initial=0.0)), 1.0)
    factor = 2.0 ** math.ceil(math.log2(reach)) / _FINE
    return Marks(np.stack([along, SUBJECT + across / factor], axis=1), factor)


def _at_rest(surface: Surface, why: str) -> Rows:
    if surface.material is None:
        raise BadInputError(
            f"look {why}, and the surface does not say where its points were; give it material"
        )
    return np.asarray(surface.material, dtype=np.float64)


def _across(look: Look) -> Rows:
    """Scratches lie where the second coordinate stays the same; the first only has to go along them."""
    grain = np.array(look.grain) / math.hypot(*look.grain)
    other = np.eye(3)[int(np.abs(grain).argmin())]
    return np.stack([np.cross(grain, other), grain])
