"""Turbulence that keeps volume: the curl of a potential of gradient noise, with exact derivatives.

Neighbours in a block mostly share a lattice cell. The gradients at its corners are drawn once for a run of
points in one cell, and loops over the run have no branches, so that they compile to vector instructions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numba import uint64

from flowsculpt.api.flows import (
    ExternalField,
    Number,
    ParameterDoc,
    PositiveNumber,
    block_kernel,
    kernel,
    number_at,
)
from flowsculpt.api.meshes import Floats

BLOCK = 256  # points at a time: their scratch numbers stay in the nearest cache

_X, _Y, _Z = uint64(0x9E3779B97F4A7C15), uint64(0xC2B2AE3D27D4EB4F), uint64(0x165667B19E3779F9)
_MOMENT, _OCTAVE = uint64(0xD6E8FEB86659FD93), uint64(0xA0761D6478BD642F)
_FIRST, _SECOND = uint64(0xBF58476D1CE4E5B9), uint64(0x94D049BB133111EB)
_BITS, _LAST = uint64(7), uint64(127)

CORNERS, GRADIENTS = 8, 9  # corners of a cell; components of the gradients of three potentials at each

PLACE, CURL, FADE, SLOPE = 0, 3 * BLOCK, 6 * BLOCK, 9 * BLOCK
"""Starts of runs of three in the scratch numbers of a block; those of one axis are BLOCK apart.

PLACE  position, lattice units; within the cell once its run is computed
CURL   the result
FADE   the fade of the position in the cell
SLOPE  its derivative
"""

SCRATCH = 12 * BLOCK


@kernel("u8(u8)", forceinline=True)
def hash_bits(h: Any) -> Any:
    """Return bits that each depend on all bits of `h` (finaliser of splitmix64: Steele, Lea & Flood 2014)."""
    h = (h ^ (h >> uint64(30))) * _FIRST
    h = (h ^ (h >> uint64(27))) * _SECOND
    return h ^ (h >> uint64(31))


@kernel("f8(f8)", forceinline=True)
def fade(s: float) -> float:
    """Return the fade at s, from 0 to 1 with three derivatives zero at the ends.

    Perlin's quintic (*Improving Noise*, 2002) has two: the velocity gradient would have kinks, at which a
    Runge-Kutta step of order 4 falls to order 3.
    """
    return s * s * s * s * (35.0 - s * (84.0 - s * (70.0 - s * 20.0)))


@kernel("f8(f8)", forceinline=True)
def fade_slope(s: float) -> float:
    """Return the derivative of `fade`."""
    r = s * (1.0 - s)
    return 140.0 * r * r * r


@kernel("f8(u8, i8)", forceinline=True)
def component(h: int, n: int) -> float:
    """Return component n of the gradients, −63.5 to 63.5: from seven bits of a hash."""
    return float(np.int32((h >> (_BITS * uint64(n))) & _LAST)) - 63.5


@kernel("void(f8, f8, f8, u8, u8, f8, f8, f8[::1])")
def draw_gradients(
    fx: float, fy: float, fz: float, now: int, next_draw: int, before: float, after: float, cell: Floats
) -> None:
    """Draw the gradients of three potentials at the corners of a cell, between two random draws in time."""
    hx, hy, hz = uint64(int(fx)) * _X, uint64(int(fy)) * _Y, uint64(int(fz)) * _Z
    for corner in range(CORNERS):
        i, j, k = corner & 1, (corner >> 1) & 1, corner >> 2
        lattice = (hx + uint64(i) * _X) ^ (hy + uint64(j) * _Y) ^ (hz + uint64(k) * _Z)
        one, other = hash_bits(lattice ^ now), hash_bits(lattice ^ next_draw)
        for n in range(GRADIENTS):
            cell[GRADIENTS * corner + n] = before * component(one, n) + after * component(other, n)


@kernel("void(f8[::1], f8, f8, f8, i8, i8, f8[::1])")
def compute_run(
    cell: Floats, fx: float, fy: float, fz: float, first: int, count: int, scratch: Floats
) -> None:
    """Compute the curl of three noises at a run of points in one cell, in lattice units.

    A noise is the sum over the corners c of its cell of weight(x − c) · gradient(c) · (x − c); this is its
    derivative, term by term.
    """
    s = scratch[first:]
    for i in range(count):
        x, y, z = s[PLACE + i] - fx, s[PLACE + BLOCK + i] - fy, s[PLACE + 2 * BLOCK + i] - fz
        s[PLACE + i], s[PLACE + BLOCK + i], s[PLACE + 2 * BLOCK + i] = x, y, z
        s[CURL + i], s[CURL + BLOCK + i], s[CURL + 2 * BLOCK + i] = 0.0, 0.0, 0.0
        s[FADE + i], s[FADE + BLOCK + i], s[FADE + 2 * BLOCK + i] = fade(x), fade(y), fade(z)
        s[SLOPE + i], s[SLOPE + BLOCK + i] = fade_slope(x), fade_slope(y)
        s[SLOPE + 2 * BLOCK + i] = fade_slope(z)
    for corner in range(CORNERS):
        ix, iy, iz = float(corner & 1), float((corner >> 1) & 1), float(corner >> 2)
        sx, sy, sz = 2.0 * ix - 1.0, 2.0 * iy - 1.0, 2.0 * iz - 1.0
        o = GRADIENTS * corner
        ax, ay, az, bx, by, bz = cell[o], cell[o + 1], cell[o + 2], cell[o + 3], cell[o + 4], cell[o + 5]
        cx, cy, cz = cell[o + 6], cell[o + 7], cell[o + 8]
        for i in range(count):
            rx, ry, rz = s[PLACE + i] - ix, s[PLACE + BLOCK + i] - iy, s[PLACE + 2 * BLOCK + i] - iz
            wx, wy = 1.0 - ix + sx * s[FADE + i], 1.0 - iy + sy * s[FADE + BLOCK + i]
            wz = 1.0 - iz + sz * s[FADE + 2 * BLOCK + i]
            gx, gy, gz = sx * s[SLOPE + i], sy * s[SLOPE + BLOCK + i], sz * s[SLOPE + 2 * BLOCK + i]
            weight = wx * wy * wz
            gx, gy, gz = gx * wy * wz, wx * gy * wz, wx * wy * gz
            a = ax * rx + ay * ry + az * rz
            b = bx * rx + by * ry + bz * rz
            c = cx * rx + cy * ry + cz * rz
            s[CURL + i] += gy * c + weight * cy - gz * b - weight * bz
            s[CURL + BLOCK + i] += gz * a + weight * az - gx * c - weight * cx
            s[CURL + 2 * BLOCK + i] += gx * b + weight * bx - gy * a - weight * ay


@kernel("void(u8, u8, f8, f8, i8, f8[::1], f8[::1])")
def compute_curl(
    now: int, next_draw: int, before: float, after: float, count: int, cell: Floats, scratch: Floats
) -> None:
    """Compute the curl at the points of a block, one run of points in a cell after another."""
    first = 0
    while first < count:
        fx, fy = np.floor(scratch[first]), np.floor(scratch[BLOCK + first])
        fz, last = np.floor(scratch[2 * BLOCK + first]), first + 1
        while (
            last < count
            and np.floor(scratch[last]) == fx
            and np.floor(scratch[BLOCK + last]) == fy
            and np.floor(scratch[2 * BLOCK + last]) == fz
        ):
            last += 1
        draw_gradients(fx, fy, fz, now, next_draw, before, after, cell)
        compute_run(cell, fx, fy, fz, first, last - first, scratch)
        first = last


@block_kernel
def curl_noise(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: frequency 0 and speed 1 of the first octave, octaves 2, the factors on both per octave 3 4,
    seed 5, age 6 (a new random draw at whole numbers).
    """
    moment = math.floor(numbers[6])
    quarter = 0.5 * math.pi * fade(numbers[6] - moment)
    before, after = math.cos(quarter), math.sin(quarter)
    cell, scratch = np.empty(CORNERS * GRADIENTS), np.empty(SCRATCH)
    for first in range(0, count, BLOCK):
        many, frequency, speed = min(BLOCK, count - first), numbers[0], numbers[1]
        for octave in range(int(numbers[2])):
            seed = hash_bits(uint64(int(numbers[5])) + uint64(octave) * _OCTAVE)
            now = seed ^ (uint64(int(moment)) * _MOMENT)
            next_draw = seed ^ (uint64(int(moment) + 1) * _MOMENT)
            for i in range(many):
                scratch[PLACE + i] = frequency * x[first + i]
                scratch[PLACE + BLOCK + i] = frequency * y[first + i]
                scratch[PLACE + 2 * BLOCK + i] = frequency * z[first + i]
            compute_curl(now, next_draw, before, after, many, cell, scratch)
            for i in range(many):
                u[first + i] += speed * scratch[CURL + i]
                v[first + i] += speed * scratch[CURL + BLOCK + i]
                w[first + i] += speed * scratch[CURL + 2 * BLOCK + i]
            frequency *= numbers[3]
            speed *= numbers[4]


RMS = 85.16306274927067
"""Root mean square of the kernel's curl: the integral over a cell of the squared factors of the 72
independent components of gradients, times their variance (128² − 1) / 12."""

GRADIENT = 11.5  # the gradient's norm, in root mean square speeds per cell, that 1 of 10⁴ points exceeds


@dataclass(frozen=True)
class CurlNoise(ExternalField):
    """Turbulence that keeps volume: the velocity is the curl of a noise.

    With ψ three noises, each a smooth random function that changes from cell to cell of a lattice,

        velocity = Σ over octaves  ∇ × ψ(lacunarityᵏ x / size) · roughnessᵏ

    scaled to a root mean square speed of `strength`. It is gradient noise with a fade of degree seven and
    exact derivatives, so that the divergence is zero to rounding. In time the gradients rotate from one
    random draw to the next, `evolution` times a second; their strength is constant.

    The gradient bound is exceeded at about one of 10⁴ points: there a sub-step is less exact.

    Source: Bridson, Houriham & Nordenstam, *Curl-Noise for Procedural Fluid Flow*, SIGGRAPH 2007; Perlin,
    *Improving Noise*, SIGGRAPH 2002.
    """

    block = curl_noise

    size: Annotated[PositiveNumber, ParameterDoc("of the largest eddies", "units")] = 1.0
    strength: Annotated[Number, ParameterDoc("root mean square speed", "units/s")] = 1.0
    octaves: Annotated[int, ParameterDoc("how many sizes of eddies", bounds=(1, 12))] = 3
    roughness: Annotated[
        float, ParameterDoc("speed of a size over that of the next larger", bounds=(0, 1))
    ] = 0.5
    lacunarity: Annotated[float, ParameterDoc("a size over the next smaller", bounds=(1, 8))] = 2.0
    evolution: Annotated[float, ParameterDoc("how often the eddies are renewed", "1/s")] = 0.5
    seed: Annotated[int, ParameterDoc("which turbulence", bounds=(0, 2**53))] = 0

    @cached_property
    def _share(self) -> float:
        """The speed of the first octave over that of all: independent speeds add up by their squares."""
        return float(sum(self.roughness ** (2 * k) for k in range(self.octaves)) ** -0.5)

    def numbers(self, time: float) -> tuple[float, ...]:
        frequency = 1.0 / number_at(self.size, time)
        speed = number_at(self.strength, time) * self._share / RMS
        shape = float(self.octaves), self.lacunarity, self.roughness, float(self.seed)
        return (frequency, speed, *shape, self.evolution * time)

    def cache_data(self, time: float) -> Any:
        return {"curl_noise": list(self.numbers(time))}

    def gradient_bound(self, time: float) -> float:
        factors = (self.roughness * self.lacunarity) ** 2
        octaves = float(sum(factors**k for k in range(self.octaves)) ** 0.5)
        first = abs(number_at(self.strength, time)) * self._share / number_at(self.size, time)
        return GRADIENT * first * octaves

    def length_scale(self, time: float) -> float:
        """Return a quarter of the smallest cell: what turns from one cell to the next varies over as much."""
        return 0.25 * number_at(self.size, time) / self.lacunarity ** (self.octaves - 1)
