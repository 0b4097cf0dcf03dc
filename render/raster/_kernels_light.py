"""How bright vertices are in a quick preview, compiled: one vertex after another."""

from __future__ import annotations

import math

from render.raster.compiled import Array, quick

_FAINT = 1e-5
"""A highlight that is darker than that, over its middle, is left out."""


@quick
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
    for row in range(which.shape[0]):
        v = which[row]
        ex, ey, ez = eye[0] - points[v, 0], eye[1] - points[v, 1], eye[2] - points[v, 2]
        shorter = _over(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex * shorter, ey * shorter, ez * shorter
        nx, ny, nz = float(normals[v, 0]), float(normals[v, 1]), float(normals[v, 2])
        facing = nx * ex + ny * ey + nz * ez
        shorter = math.copysign(_over(nx * nx + ny * ny + nz * nz), facing)
        nx, ny, nz, facing = nx * shorter, ny * shorter, nz * shorter, facing * shorter
        rising = 0.5 + 0.5 * (2.0 * facing * ny - ey)
        own = v if len(colours) > 1 else 0
        for k in range(3):
            body, mirror = coat[0] * colours[own, k], coat[1] * colours[own, k] + coat[2]
            around = body * sky[0, k] * (0.6 + 0.4 * ny)
            around += mirror * (sky[1, k] * rising + sky[0, k] * (1.2 - rising))
            out[row, k] = out[row, 3 + k] = around
        for i in range(lamps.shape[0]):
            x, y, z, strength = lamps[i, 0], lamps[i, 1], lamps[i, 2], 1.0
            if lamps[i, 9] > 0.0:
                x, y, z = x - points[v, 0], y - points[v, 1], z - points[v, 2]
                squared = x * x + y * y + z * z
                shorter = _over(squared)
                x, y, z = x * shorter, y * shorter, z * shorter
                turned = -(x * lamps[i, 3] + y * lamps[i, 4] + z * lamps[i, 5])
                strength = max(turned, 0.0) / squared
            strength *= max(0.0, nx * x + ny * y + nz * z)
            if strength == 0.0:
                continue
            x, y, z = x + ex, y + ey, z + ez
            half = (nx * x + ny * y + nz * z) * _over(x * x + y * y + z * z)
            glint = (sharp + 8.0) / (8.0 * math.pi) * half**sharp if half > least else 0.0
            for k in range(3):
                body, mirror = coat[0] * colours[own, k], coat[1] * colours[own, k] + coat[2]
                sent = strength * lamps[i, 6 + k] * (body / math.pi + mirror * glint)
                out[row, k] += sent
                if i > 0:
                    out[row, 3 + k] += sent


@quick
def _over(squared: float) -> float:
    """One over the length of a vector."""
    return 1.0 / math.sqrt(max(squared, 1e-300))


@quick
def keyed(sent: Array, share: Array, out: Array) -> None:
    """What vertices send, out (N, 3), that see a share (N,) of the key light; sent (N, 6) as `light` says."""
    for n in range(share.shape[0]):
        for k in range(3):
            out[n, k] = sent[n, 3 + k] + share[n] * (sent[n, k] - sent[n, 3 + k])
