"""Kernels: the light that vertices send to the camera."""

from __future__ import annotations

import math

from render.raster.kernels.projection import Array, fast

_FAINT = 1e-5
"""Part of a highlight's brightness below which it is left out."""

_HORIZON_SLOPE = 2.0
"""Sharpness of the transition from ground to sky in reflections."""


@fast
def shade_vertices(
    points: Array,
    normals: Array,
    colours: Array,
    which: Array,
    side: int,
    eye: Array,
    reflection: Array,
    sky: Array,
    lights: Array,
    out: Array,
) -> None:
    """Compute the light of vertices with the first of the lights (3) and without it (3), into out (N, 6).

    points      (V, 3), as normals (V, 3), and colours (V, 3) or (1, 3)
    which       (N,), the vertices to shade
    side        0 if both sides may be visible: normals then turn to the eye. For a closed surface 1, or -1 if
                its normals point inwards; a vertex just behind its outline stays outside
    reflection  (3,): weights of the colour as a body and as a mirror, and of the reflection
    sky         (4, 3): radiance of the horizon, of the zenith and of the ground; last the exponent of
    highlights
    lights      (L, 10): for a softbox its position, the direction it faces, radiance times area, and half its
                width; for a sun the direction to it, 0, 0, 0, irradiance, and 0
    """
    exponent = sky[3, 0]
    least = _FAINT ** (1.0 / exponent)
    for row in range(which.shape[0]):
        v = which[row]
        ex, ey, ez = eye[0] - points[v, 0], eye[1] - points[v, 1], eye[2] - points[v, 2]
        scale = _inverse_length(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        nx, ny, nz = float(normals[v, 0]), float(normals[v, 1]), float(normals[v, 2])
        facing = nx * ex + ny * ey + nz * ez
        scale = _inverse_length(nx * nx + ny * ny + nz * nz)
        if side < 0 or (side == 0 and facing < 0.0):
            scale = -scale
        nx, ny, nz, facing = nx * scale, ny * scale, nz * scale, max(facing * scale, 0.0)
        reflected_y = 2.0 * facing * ny - ey
        sky_weight = min(max(0.5 + _HORIZON_SLOPE * reflected_y, 0.0), 1.0)
        index = v if len(colours) > 1 else 0
        for k in range(3):
            body, mirror = (
                reflection[0] * colours[index, k],
                reflection[1] * colours[index, k] + reflection[2],
            )
            ambient = body * (sky[0, k] * (0.6 + 0.4 * ny) + sky[2, k] * (0.5 - 0.5 * ny))
            mirrored = sky[1, k] * (0.5 + 0.5 * reflected_y) + sky[0, k] * (0.7 - 0.5 * reflected_y)
            ambient += mirror * (sky_weight * mirrored + (1.0 - sky_weight) * sky[2, k])
            out[row, k] = out[row, 3 + k] = ambient
        for i in range(lights.shape[0]):
            x, y, z, strength, half_width = lights[i, 0], lights[i, 1], lights[i, 2], 1.0, 0.0
            if lights[i, 9] > 0.0:
                x, y, z = x - points[v, 0], y - points[v, 1], z - points[v, 2]
                squared = x * x + y * y + z * z
                scale = _inverse_length(squared)
                x, y, z = x * scale, y * scale, z * scale
                emitter_cosine = -(x * lights[i, 3] + y * lights[i, 4] + z * lights[i, 5])
                strength, half_width = max(emitter_cosine, 0.0) / squared, lights[i, 9] * scale
            cosine = nx * x + ny * y + nz * z
            if cosine < half_width and half_width > 0.0:  # the softbox crosses the horizon of the surface
                cosine = max(cosine + half_width, 0.0) ** 2 / (4.0 * half_width)
            strength *= max(cosine, 0.0)
            if strength == 0.0:
                continue
            x, y, z = x + ex, y + ey, z + ez
            half = (nx * x + ny * y + nz * z) * _inverse_length(x * x + y * y + z * z)
            highlight = (exponent + 8.0) / (8.0 * math.pi) * half**exponent if half > least else 0.0
            for k in range(3):
                body, mirror = (
                    reflection[0] * colours[index, k],
                    reflection[1] * colours[index, k] + reflection[2],
                )
                sent = strength * lights[i, 6 + k] * (body / math.pi + mirror * highlight)
                out[row, k] += sent
                if i > 0:
                    out[row, 3 + k] += sent


@fast
def _inverse_length(squared: float) -> float:
    """Return one over the length of a vector."""
    return 1.0 / math.sqrt(max(squared, 1e-300))


@fast
def apply_shadow(light: Array, visibility: Array, out: Array) -> None:
    """Mix light (N, 6) of `shade_vertices` by the visible fraction (N,) of the key light, into out (N, 3)."""
    for n in range(visibility.shape[0]):
        for k in range(3):
            out[n, k] = light[n, 3 + k] + visibility[n] * (light[n, k] - light[n, 3 + k])
