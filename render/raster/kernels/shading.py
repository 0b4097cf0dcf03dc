"""How bright vertices are in a quick preview, compiled: one vertex after another."""

from __future__ import annotations

import math

from render.raster.compiled import Array, quick

_FAINT = 1e-5
"""A highlight that is darker than that, over its middle, is left out."""


_GRADUAL = 2.0
"""How soon what a mirror shows goes over from the ground to the sky, where it looks along the horizon."""


@quick
def light(
    points: Array,
    normals: Array,
    colours: Array,
    which: Array,
    side: int,
    eye: Array,
    coat: Array,
    sky: Array,
    lamps: Array,
    out: Array,
) -> None:
    """What light vertices send to the eye: with the first of the lamps, and without it, which casts a shadow.

    points   (V, 3), as normals (V, 3) and colours (V, 3) or (1, 3); `which` (N,), those looked at
    coat     (3,): the share of the colour that is a body's, and that is a mirror's; and how clear the coat is
    side     0 where both sides may be seen, so that normals turn to the eye; of a closed surface 1, or -1
             where they point inwards: a vertex just behind its outline is no inside
    sky      (4, 3): radiance of the horizon, of the zenith and of the ground; last how sharp highlights are
    lamps    (L, 10): for a softbox its place, the way it faces, radiance times area, and half its width; for
             a sun the way to it, nothing, irradiance, and 0
    out      (N, 6)
    """
    sharp = sky[3, 0]
    least = _FAINT ** (1.0 / sharp)
    for row in range(which.shape[0]):
        v = which[row]
        ex, ey, ez = eye[0] - points[v, 0], eye[1] - points[v, 1], eye[2] - points[v, 2]
        shorter = _over(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex * shorter, ey * shorter, ez * shorter
        nx, ny, nz = float(normals[v, 0]), float(normals[v, 1]), float(normals[v, 2])
        facing = nx * ex + ny * ey + nz * ez
        shorter = _over(nx * nx + ny * ny + nz * nz)
        if side < 0 or (side == 0 and facing < 0.0):
            shorter = -shorter
        nx, ny, nz, facing = nx * shorter, ny * shorter, nz * shorter, max(facing * shorter, 0.0)
        rising = 2.0 * facing * ny - ey
        above = min(max(0.5 + _GRADUAL * rising, 0.0), 1.0)
        own = v if len(colours) > 1 else 0
        for k in range(3):
            body, mirror = coat[0] * colours[own, k], coat[1] * colours[own, k] + coat[2]
            around = body * (sky[0, k] * (0.6 + 0.4 * ny) + sky[2, k] * (0.5 - 0.5 * ny))
            mirrored = sky[1, k] * (0.5 + 0.5 * rising) + sky[0, k] * (0.7 - 0.5 * rising)
            around += mirror * (above * mirrored + (1.0 - above) * sky[2, k])
            out[row, k] = out[row, 3 + k] = around
        for i in range(lamps.shape[0]):
            x, y, z, strength, wide = lamps[i, 0], lamps[i, 1], lamps[i, 2], 1.0, 0.0
            if lamps[i, 9] > 0.0:
                x, y, z = x - points[v, 0], y - points[v, 1], z - points[v, 2]
                squared = x * x + y * y + z * z
                shorter = _over(squared)
                x, y, z = x * shorter, y * shorter, z * shorter
                turned = -(x * lamps[i, 3] + y * lamps[i, 4] + z * lamps[i, 5])
                strength, wide = max(turned, 0.0) / squared, lamps[i, 9] * shorter
            risen = nx * x + ny * y + nz * z
            if risen < wide and wide > 0.0:  # part of it is below the surface, and part may rise above it
                risen = max(risen + wide, 0.0) ** 2 / (4.0 * wide)
            strength *= max(risen, 0.0)
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
