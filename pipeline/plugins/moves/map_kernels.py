"""The compiled functions of `keyed_maps`: in finding delays they are called again and again."""

from __future__ import annotations

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats


@kernel("void(f8[:, ::1], f8[::1], f8[:, ::1])")
def interpolate(table: Floats, places: Floats, numbers: Floats) -> None:
    """Write the numbers (N, K) at places (N,) in a table (S, K), by Catmull and Rom's cubic."""
    for i in range(len(places)):
        j = min(max(int(places[i]), 0), len(table) - 3)
        s, before = places[i] - j, max(j - 1, 0)
        w0, w1 = 0.5 * (s * (s * (2.0 - s) - 1.0)), 0.5 * (2.0 + s * s * (3.0 * s - 5.0))
        w2, w3 = 0.5 * (s * (1.0 + s * (4.0 - 3.0 * s))), 0.5 * (s * s * (s - 1.0))
        for k in range(table.shape[1]):
            outer = w3 * table[j + 2, k] + w0 * table[before, k]
            numbers[i, k] = outer + w1 * table[j, k] + w2 * table[j + 1, k]


@kernel("void(f8[:, :], f8[:, ::1], f8[:, ::1])")
def undo_affine(numbers: Floats, points: Floats, out: Floats) -> None:
    """Write the points (N, 3) that maps move to `points`: rows (N or 1, 12) of matrices (3, 4)."""
    for i in range(len(points)):
        m = numbers[min(i, len(numbers) - 1)]
        x, y, z = points[i, 0] - m[3], points[i, 1] - m[7], points[i, 2] - m[11]
        ux, uy, uz = m[5] * m[10] - m[9] * m[6], m[9] * m[2] - m[1] * m[10], m[1] * m[6] - m[5] * m[2]
        vx, vy, vz = m[6] * m[8] - m[10] * m[4], m[10] * m[0] - m[2] * m[8], m[2] * m[4] - m[6] * m[0]
        wx, wy, wz = m[4] * m[9] - m[8] * m[5], m[8] * m[1] - m[0] * m[9], m[0] * m[5] - m[4] * m[1]
        volume = m[0] * ux + m[4] * uy + m[8] * uz
        out[i, 0] = (ux * x + uy * y + uz * z) / volume
        out[i, 1] = (vx * x + vy * y + vz * z) / volume
        out[i, 2] = (wx * x + wy * y + wz * z) / volume
