"""The equations of attractors, upright: in their own coordinates z is our y (up), and y our −z.

The numbers of all begin alike: origin 0:3, the point where the attractor's own coordinates are zero; scale 3,
its units per unit of ours; time scale / scale 4; then its own parameters from 5 on.
"""

from __future__ import annotations

import math

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats

_FLOATS = "CPointer(f8)"


@kernel(f"UniTuple(f8, 3)({_FLOATS}, f8, f8, f8)", forceinline=True)
def own_place(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a point in the attractor's coordinates."""
    scale = p[3]
    return scale * (x - p[0]), -scale * (z - p[2]), scale * (y - p[1])


@kernel(f"void({', '.join([_FLOATS] * 4)}, i8, f8, f8, f8)", forceinline=True)
def add(p: Floats, u: Floats, v: Floats, w: Floats, i: int, du: float, dv: float, dw: float) -> None:
    """Add a velocity of the attractor's coordinates to that of point i in the scene's."""
    speed = p[4]
    u[i] += speed * du
    v[i] += speed * dw
    w[i] += -speed * dv


@block_kernel
def rossler(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: a 5, b 6, c 7."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        add(p, u, v, w, i, -oy - oz, ox + p[5] * oy, p[6] + oz * (ox - p[7]))


@block_kernel
def aizawa(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: a 5, b 6, c 7, d 8, e 9, f 10."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        du = (oz - p[6]) * ox - p[8] * oy
        dv = p[8] * ox + (oz - p[6]) * oy
        dw = p[7] + p[5] * oz - oz * oz * oz / 3.0
        dw += p[10] * oz * ox * ox * ox - (ox * ox + oy * oy) * (1.0 + p[9] * oz)
        add(p, u, v, w, i, du, dv, dw)


@block_kernel
def thomas(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: b 5."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        b = p[5]
        add(p, u, v, w, i, math.sin(oy) - b * ox, math.sin(oz) - b * oy, math.sin(ox) - b * oz)


@block_kernel
def chua(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: alpha 5, beta 6, c 7."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        add(p, u, v, w, i, p[5] * (oy - ox * ox * ox - p[7] * ox), ox - oy + oz, -p[6] * oy)


@block_kernel
def halvorsen(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: a 5."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        a = p[5]
        du = -a * ox - 4.0 * (oy + oz) - oy * oy
        dv = -a * oy - 4.0 * (oz + ox) - oz * oz
        add(p, u, v, w, i, du, dv, -a * oz - 4.0 * (ox + oy) - ox * ox)


@block_kernel
def chen(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: a 5, b 6, c 7."""
    for i in range(count):
        ox, oy, oz = own_place(p, x[i], y[i], z[i])
        a, c = p[5], p[7]
        add(p, u, v, w, i, a * (oy - ox), (c - a) * ox - ox * oz + c * oy, ox * oy - p[6] * oz)
