"""Textures of patterns, evaluated at every sample of a picture: colours, roughness, and normals of relief.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started. The vertices of the
surface have their rest positions as an attribute, which faces interpolate; the pattern there is that of
`flowsculpt.render.scene.noise`, in single precision. Relief needs the gradient of the height over the present
surface: vertices also have the rows of the matrix by which steps on that surface become steps at rest, the
mean over their faces.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene import noise
from flowsculpt.render.scene.patterns import CELLS, OUTSIDE, TEXELS, Pigment, in_ramp
from flowsculpt.render.scene.surface import Surface

PLACE = "pattern_place"
"""Name of the vertex attribute (V, 3) with rest positions."""

ROWS = ("pattern_x", "pattern_y", "pattern_z")
"""Names of the vertex attributes (V, 3) with the rows of the matrix from present steps to steps at rest."""

FARTHEST = 1e6
"""Scales from a pattern's centre up to which texels have numbers of 32 bits, and pictures no NaN."""

STEP = 2e-3
"""Length of steps at rest by which relief is differentiated, in scales of the pattern."""


def with_places(surface: Surface, pigment: Pigment) -> Surface:
    """Return the surface with the vertex attributes that the textures of a pigment read.

    Raises BadInputError where it has no rest positions, or they are too far from the pattern's centre.
    """
    at_rest = pigment.places(surface)
    reach = float(np.linalg.norm(at_rest - pigment.centre, axis=1).max()) / pigment.scale + pigment.turbulence
    if reach > FARTHEST and pigment.pattern != "palette":
        raise BadInputError(
            f"look's pigment has scale {pigment.scale:g}, and the surface reaches {reach:.3g} scales from "
            f"its centre; patterns go as far as {FARTHEST:g}. Raise scale, or move centre"
        )
    places = {PLACE: at_rest.astype(np.float32)}
    if pigment.heights:
        rest = surface.require_rest("look has a relief")
        rows = steps_at_rest(surface.vertices.astype(np.float64), rest, surface.faces)
        places |= {name: rows[:, k].astype(np.float32) for k, name in enumerate(ROWS)}
    return replace(surface, attributes={**surface.attributes, **places})


def steps_at_rest(
    now: NDArray[np.float64], rest: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return matrices (V, 3, 3) from steps on the present surface to those of the same material at rest.

    On a triangle with edges e now and E at rest it is E e⁺, with the pseudoinverse; at a vertex, the mean of
    its triangles, weighted by area.
    """
    present, before = (
        np.stack([p[faces[:, k]] - p[faces[:, 0]] for k in (1, 2)], axis=2) for p in (now, rest)
    )
    gram = np.einsum("fki,fkj->fij", present, present)
    area = np.maximum(gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2, 0.0)
    adjugate = np.empty_like(gram)
    adjugate[:, 0, 0], adjugate[:, 1, 1] = gram[:, 1, 1], gram[:, 0, 0]
    adjugate[:, 0, 1] = adjugate[:, 1, 0] = -gram[:, 0, 1]
    weight = np.sqrt(area)
    scale = np.where(weight > 0.0, 1.0 / np.maximum(weight, 1e-150), 0.0)[:, None, None]
    weighted = np.einsum("fki,fij,flj->fkl", before, adjugate * scale, present).reshape(-1, 9)
    corners, count = faces.reshape(-1), len(now)
    sums = np.stack([np.bincount(corners, np.repeat(part, 3), count) for part in weighted.T], axis=1)
    total = np.bincount(corners, np.repeat(weight, 3), count)[:, None]
    return np.asarray((sums / np.maximum(total, 1e-150)).reshape(-1, 3, 3))


def pattern_texture(pigment: Pigment, of: str = "colours", is_rooted: bool = False) -> Any:
    """Return the texture of a pigment's colours or roughness; rooted, of the square root of roughness."""
    values = pigment.ramp(of)
    return PatternTexture(mi.Properties(), pigment, np.sqrt(values) if is_rooted else values)


def relief_normals(pigment: Pigment) -> Any:
    """Return the texture that a `normalmap` reads: normals of a pigment's relief in the surface's frame."""
    return ReliefNormals(mi.Properties(), pigment, pigment.ramp("heights"))


class PatternTexture(mi.Texture):
    """Return the value of a ramp (TEXELS, 1 or 3) at the phase of a pigment."""

    def __init__(
        self, properties: Any, pigment: Pigment | None = None, ramp: NDArray[np.float32] | None = None
    ) -> None:
        super().__init__(properties)
        assert pigment is not None and ramp is not None, "is made by `pattern_texture`"
        self.pigment, self.channels, self.average = pigment, ramp.shape[1], float(ramp.mean())
        self.ramp = mi.Float(np.ascontiguousarray(ramp).ravel())

    def at(self, places: Any, active: Any) -> Any:
        """Return the value at rest positions, blended between neighbours on the ramp."""
        phase = _phase(self.pigment, places) * TEXELS - 0.5
        low = mi.Int32(dr.floor(phase))
        share = phase - mi.Float(low)
        blended: Any = 0.0
        for place, weight in ((low, 1.0 - share), (low + 1, share)):
            inside = place & (TEXELS - 1) if self.pigment.repeats else dr.clip(place, 0, TEXELS - 1)
            kind = mi.Float if self.channels == 1 else mi.Color3f
            blended = blended + weight * dr.gather(kind, self.ramp, mi.UInt32(inside), active)
        return blended

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(self.at(_place(si, active), active))

    def eval_1(self, si: Any, active: Any = True) -> Any:
        value = self.at(_place(si, active), active)
        return value if self.channels == 1 else mi.luminance(value)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        return self.eval(si, active)

    def mean(self) -> Any:
        return mi.Float(self.average)

    def is_spatially_varying(self) -> bool:
        return True

    def to_string(self) -> str:
        return f"{type(self).__name__}[{self.pigment}]"


class ReliefNormals(PatternTexture):
    """Return the normals of the relief of a ramp of heights, as colours from 0 to 1."""

    def eval_3(self, si: Any, active: Any = True) -> Any:
        place = _place(si, active)
        rows = [si.shape.eval_attribute_3(f"vertex_{name}", si, active) for name in ROWS]
        height, length = self.at(place, active), STEP * self.pigment.scale
        slopes = []
        for axis in (si.sh_frame.s, si.sh_frame.t):
            at_rest = mi.Vector3f(*(dr.dot(mi.Vector3f(row), axis) for row in rows))
            stretch = dr.norm(at_rest)
            beyond = place + at_rest * (length / dr.maximum(stretch, 1e-12))
            slopes.append((self.at(beyond, active) - height) * (stretch / length))
        normal = dr.normalize(mi.Vector3f(-slopes[0], -slopes[1], 1.0))
        return mi.Color3f(0.5 * normal + 0.5)


def _place(si: Any, active: Any) -> Any:
    return mi.Point3f(si.shape.eval_attribute_3(f"vertex_{PLACE}", si, active))


def _phase(pigment: Pigment, places: Any) -> Any:
    """Return the phases of rest positions: `Pigment.phases`, by compiled code."""
    if pigment.pattern == "palette":
        return places.x
    p = (places - mi.Point3f(pigment.centre)) / pigment.scale
    if pigment.turbulence:
        p += pigment.turbulence * fractal_noise(p, pigment.octaves, pigment.seed)
    count = len(pigment.colours)
    if pigment.pattern in ("speckles", "spots"):
        choice, distance = nearest_spot(p, mi.UInt32(pigment.seed))
        if pigment.pattern == "speckles":
            return distance
        depth = 1.0 - distance / max(pigment.share, 1e-9)
    if pigment.pattern == "chips":
        choice, depth = _cells(p, pigment.seed, pigment.share, pigment.gap, pigment.sizes)
    if pigment.pattern in CELLS:
        count = count - 1
        return (dr.floor(choice * count) + in_ramp(dr.clip(depth, OUTSIDE, 1.0))) / count
    if pigment.pattern == "radial":
        return dr.maximum(dr.norm(mi.Vector3f(p)), 0.5 * pigment.softness) / count
    axis = mi.Vector3f([float(part) / math.hypot(*pigment.axis) for part in pigment.axis])
    along = dr.dot(mi.Vector3f(p), axis)
    if pigment.pattern == "rings":
        return dr.norm(mi.Vector3f(p) - along * axis) / count
    if pigment.pattern == "gradient":
        return along + 0.5
    return along / count if pigment.pattern == "layers" else along


def _hashed(word: Any) -> Any:
    """Return `noise._hash_word` of 32 bits."""
    word = (word ^ (word >> 16)) * mi.UInt32(0x85EBCA6B)
    word = (word ^ (word >> 13)) * mi.UInt32(0xC2B2AE35)
    return word ^ (word >> 16)


def _numbers(cell: list[Any], seed: Any, count: int) -> list[Any]:
    """Return numbers from 0 to 1 by the lattice cell and the seed, as `noise._cell_numbers`."""
    factors = (0x8DA6B343, 0xD8163841, 0xCB1AB31F)
    x, y, z = (mi.UInt32(part) * mi.UInt32(factor) for part, factor in zip(cell, factors, strict=True))
    word, numbers = _hashed((x ^ y ^ z) + seed), []
    for _ in range(count):
        word = _hashed(word + mi.UInt32(0x9E3779B9))
        numbers.append(mi.Float(word) * 2.0**-32)
    return numbers


def fractal_noise(p: Any, octaves: int, seed: int) -> Any:
    """Return displacements, as `noise.fractal_noise`."""
    turn, lattice, total = noise.rotation().T.tolist(), mi.Vector3f(p), mi.Vector3f(0.0)
    for octave in range(octaves):
        word = mi.UInt32((0x9E3779B9 * (octave + 1) + seed) % 2**32)
        total += 0.5 ** (octave + 1) * _value_noise(lattice, word)
        lattice = mi.Vector3f([2.0 * dr.dot(mi.Vector3f(row), lattice) + 17.31 for row in turn])
    return total


def _value_noise(lattice: Any, word: Any) -> Any:
    """Return noise of three channels between −1 and 1, as `noise._add_value_noise`."""
    cell = dr.floor(lattice)
    t, total = lattice - cell, mi.Vector3f(0.0)
    fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    for corner in range(8):
        steps = corner >> 2, corner >> 1 & 1, corner & 1
        weight: Any = 1.0
        for k, step in enumerate(steps):
            weight = weight * (fade[k] if step else 1.0 - fade[k])
        at = [mi.Int32(part) + step for part, step in zip(cell, steps, strict=True)]
        total += weight * (2.0 * mi.Vector3f(*_numbers(at, word, 3)) - 1.0)
    return total


@dr.syntax
def _cells(p: Any, seed: int, share: float, gap: float, sizes: int) -> tuple[Any, Any]:
    """Return the numbers and depths of chips, as `noise.cells`."""
    clear, choice, depth = mi.Float(dr.inf), mi.Float(0.0), mi.Float(0.0)
    size, lattice, is_outside = mi.UInt32(0), mi.Point3f(p), mi.Bool(True)
    while dr.hint(is_outside & (size < sizes), label="chips", exclude=[seed, share, gap, sizes]):
        inside, outside, choice = _chip(lattice, size + mi.UInt32(seed), share, gap)
        depth = dr.select(size > 0, dr.minimum(inside, 2.0 * clear - gap), inside)
        clear = noise.FINER * dr.minimum(clear, outside)
        lattice *= noise.FINER
        is_outside = depth <= 0.0
        size += 1
    return choice, depth


@dr.syntax
def nearest_spot(p: Any, seed: Any) -> tuple[Any, Any]:
    """Return the number of the nearest spot, and the distance to it over its size."""
    low, i = mi.Vector3i(dr.floor(p)), mi.Int32(0)
    best, choice = mi.Float(dr.inf), mi.Float(0.0)
    while dr.hint(i < 27, label="spots", exclude=[low, p, seed]):
        at = low + _neighbour(i)
        x, y, z, size, number = _numbers(list(at), seed, 5)
        distance = dr.norm(mi.Vector3f(at) + mi.Vector3f(x, y, z) - mi.Vector3f(p)) / (0.5 + 0.5 * size)
        choice, best = dr.select(distance < best, number, choice), dr.minimum(best, distance)
        i += 1
    return choice, best


@dr.syntax
def _chip(p: Any, seed: Any, share: float, gap: float) -> tuple[Any, Any, Any]:
    """Return depth, distance and number, as `noise._find_chip`."""
    low, i, best, choice = mi.Vector3i(dr.floor(p)), mi.Int32(0), mi.Float(dr.inf), mi.Float(0.0)
    found, cell, border, presence = mi.Point3f(0.0), mi.Vector3i(0), mi.Float(0.0), mi.Float(0.0)
    while dr.hint(i < 27, label="cells", exclude=[low, p, seed, share, gap]):
        at = low + _neighbour(i)
        point, own_border, number, own_presence = _cell(at, seed, gap)
        distance = dr.squared_norm(point - p)
        nearer = distance < best
        best, choice = dr.select(nearer, distance, best), dr.select(nearer, number, choice)
        presence, border = (
            dr.select(nearer, own_presence, presence),
            dr.select(nearer, own_border, border),
        )
        found, cell = dr.select(nearer, point, found), dr.select(nearer, at, cell)
        i += 1
    edge, outside, i = mi.Float(dr.inf), mi.Float(dr.inf), mi.Int32(0)
    while dr.hint(i < 27, label="borders", exclude=[cell, found, p, seed, share, gap]):
        other, own_border, _, own_presence = _cell(cell + _neighbour(i), seed, gap)
        away = other - found
        distance = dr.dot(0.5 * (mi.Vector3f(other) + mi.Vector3f(found)) - mi.Vector3f(p), away)
        distance = dr.select(i == 13, dr.inf, distance * dr.rsqrt(dr.maximum(dr.squared_norm(away), 1e-12)))
        edge = dr.minimum(edge, distance)
        outside = dr.select(own_presence < share, dr.minimum(outside, distance + own_border), outside)
        i += 1
    is_there = presence < share
    outside = dr.select(is_there, dr.minimum(outside, border - edge), outside)
    return dr.select(is_there, 2.0 * (edge - border), -1.0), outside, choice


def _neighbour(i: Any) -> Any:
    """Return the step to one of 27 cells."""
    return mi.Vector3i(i // 9 - 1, i // 3 % 3 - 1, i % 3 - 1)


def _cell(at: Any, seed: Any, gap: float) -> tuple[Any, Any, Any, Any]:
    """Return the point of a cell of chips, the width of its border, and two numbers."""
    x, y, z, size, number, presence = _numbers(list(at), seed, 6)
    point = mi.Point3f(at) + 0.5 + noise.JITTER * (mi.Point3f(x, y, z) - 0.5)
    return point, gap * (0.5 + noise.SHRINKS * dr.square(size)), number, presence
