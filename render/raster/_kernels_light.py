"""How bright vertices are in a quick preview, compiled: one vertex after another."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_FAINT = 1e-5
"""A highlight that is darker than that, over its middle, is left out."""

QUICK = {"contract", "reassoc", "arcp", "nsz"}
"""What may be done with sums and quotients: a picture for a moment need not have the same bits everywhere."""

compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=QUICK)


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def light(
    points: Array,
    normals: Array,
    colours: Array,
    which: Array,
    eye: Array,
    coat: Array,
    sky: Array,
    lamps: Array,
    out: Array,
) -> None:
    """What light vertices send to the eye: with the first of the lamps, and without it, which casts a shadow.

    points   (V, 3), as normals (V, 3) and colours (V, 3) or (1, 3); `which` (N,), those looked at
    coat     (3,): the share of the colour that is a body's, and that is a mirror's; and how clear the coat is
    sky      (3, 3): radiance of the horizon and of the zenith; in the last row how sharp highlights are
    lamps    (L, 10): for a softbox its place, the way it faces, radiance times area, and 1; for a sun the way
             to it, nothing, irradiance, and 0
    out      (N, 6). Both sides of a surface are lit
    """
    sharp = sky[2, 0]
    least = _FAINT ** (1.0 / sharp)
    body, mirror, n, to_eye, towards = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for row in range(which.shape[0]):
        v = which[row]
        colour = colours[v if len(colours) > 1 else 0]
        for k in range(3):
            body[k] = coat[0] * colour[k]
            mirror[k] = coat[1] * colour[k] + coat[2]
            to_eye[k] = eye[k] - points[v, k]
            n[k] = normals[v, k]
        _shorten(to_eye)
        _shorten(n)
        facing = n[0] * to_eye[0] + n[1] * to_eye[1] + n[2] * to_eye[2]
        if facing < 0.0:
            for k in range(3):
                n[k] = -n[k]
            facing = -facing
        rising = 0.5 + 0.5 * (2.0 * facing * n[1] - to_eye[1])
        for k in range(3):
            around = body[k] * sky[0, k] * (0.6 + 0.4 * n[1])
            around += mirror[k] * (sky[1, k] * rising + sky[0, k] * (1.2 - rising))
            out[row, k] = out[row, 3 + k] = around
        for i in range(lamps.shape[0]):
            strength = 1.0
            if lamps[i, 9] > 0.0:
                for k in range(3):
                    towards[k] = lamps[i, k] - points[v, k]
                squared = towards[0] ** 2 + towards[1] ** 2 + towards[2] ** 2
                _shorten(towards)
                turned = -(towards[0] * lamps[i, 3] + towards[1] * lamps[i, 4] + towards[2] * lamps[i, 5])
                strength = max(turned, 0.0) / squared
            else:
                towards[:] = lamps[i, :3]
            strength *= max(0.0, n[0] * towards[0] + n[1] * towards[1] + n[2] * towards[2])
            if strength == 0.0:
                continue
            half, along = 0.0, 0.0
            for k in range(3):
                between = towards[k] + to_eye[k]
                half += n[k] * between
                along += between * between
            half /= math.sqrt(max(along, 1e-300))
            glint = (sharp + 8.0) / (8.0 * math.pi) * half**sharp if half > least else 0.0
            for k in range(3):
                sent = strength * lamps[i, 6 + k] * (body[k] / math.pi + mirror[k] * glint)
                out[row, k] += sent
                if i > 0:
                    out[row, 3 + k] += sent


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def _shorten(vector: Array) -> None:
    """To a length of 1."""
    length = max(math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2), 1e-300)
    for k in range(3):
        vector[k] /= length
