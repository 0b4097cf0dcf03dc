"""The equations of crossed waves. All numbers begin with the centre 0:3 and the wave number 3."""

from __future__ import annotations

import math

from flowsculpt.api.flows import block_kernel
from flowsculpt.api.meshes import Floats


@block_kernel
def taylor_green(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: speed 4."""
    for i in range(count):
        kx, ky, kz = p[3] * (x[i] - p[0]), p[3] * (y[i] - p[1]), p[3] * (z[i] - p[2])
        speed = p[4] * math.cos(kz)
        u[i] += speed * math.sin(kx) * math.cos(ky)
        v[i] += -speed * math.cos(kx) * math.sin(ky)


@block_kernel
def kneading(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: speeds 4:7."""
    for i in range(count):
        kx, ky, kz = p[3] * (x[i] - p[0]), p[3] * (y[i] - p[1]), p[3] * (z[i] - p[2])
        u[i] += p[4] * math.sin(ky)
        v[i] += p[5] * math.sin(kz)
        w[i] += p[6] * math.sin(kx)
