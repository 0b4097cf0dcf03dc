"""Attractors, upright: in their own coordinates z is our y (up), and y our −z."""

from __future__ import annotations

from pipeline.arrays import Floats
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_block import EQUATION, LEAVES, Velocity, add_each
from pipeline.kernels import kernel


@kernel(EQUATION, forceinline=True)
def lorenz(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, sigma 3, rho 4, beta 5, scale 6, time scale 7"""
    scale, speed = p[o + 6], p[o + 7] / p[o + 6]
    lx, ly, lz = scale * (x - p[o]), -scale * (z - p[o + 2]), scale * (y - p[o + 1]) + p[o + 4] - 1.0
    return (
        speed * p[o + 3] * (ly - lx),
        speed * (lx * ly - p[o + 5] * lz),
        -speed * (lx * (p[o + 4] - lz) - ly),
    )


@kernel(LEAVES)
def attractors(kind: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the field of an opcode to n points of the level at s[b]."""
    if kind == op.LORENZ:
        add_each(lorenz, p, o, n, s, b)
