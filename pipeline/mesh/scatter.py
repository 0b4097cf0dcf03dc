"""Scatter points evenly, reproducibly by seed: on a surface, or inside one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.mesh.triangle_mesh import TriangleMesh

_GOLDEN = 1.2207440846057596
"""The root of g⁴ = g + 1."""

_PROBES = 4096


def on_surface(mesh: TriangleMesh, count: int, seed: int) -> Points:
    """Return points (count, 3) on a mesh, evenly by area.

    mesh  should have at least about as many faces as points

    The areas of the faces, in order, form a line with points at equal distances. Within its face a point lies
    anywhere, but only half as far from the middle as it could: points of neighbouring faces then keep apart,
    without clusters or holes.
    """
    random = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    along = (np.arange(count) + random.random()) / count * ends[-1]
    face = np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1)
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    u, v = 0.5 * u + 1.0 / 6.0, 0.5 * v + 1.0 / 6.0
    points: Points = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points


def within(bounds: Floats, inside: Callable[[Points], AnyArray], count: int, seed: int) -> Points:
    """Return points (count, 3) of the box `bounds` (2, 3) that are inside.

    inside  returns flags (N,) for points (N, 3); some of the box must be inside

    The places are those of the additive recurrence by the generalised golden ratio (Roberts, *The
    unreasonable effectiveness of quasirandom sequences*, 2018), which fills a box evenly for any count. Each
    is moved by up to 0.4 of the distance between two, which hides the rows.
    """
    random = np.random.default_rng(seed)
    low, extent = bounds[0], bounds[1] - bounds[0]
    shift, step = random.random(3), _GOLDEN ** -np.arange(1.0, 4.0)

    def places(first: int, last: int) -> Points:
        there: Points = low + extent * ((shift + np.arange(first, last)[:, None] * step) % 1.0)
        return there

    share = max(float(inside(places(0, _PROBES)).mean()), 1.0 / _PROBES)
    reach = 0.4 * float((extent.prod() * share / count) ** (1.0 / 3.0))
    batch = int(count / share) + _PROBES
    accepted: list[Points] = []
    taken = 0
    while sum(map(len, accepted)) < count:
        tried = places(taken, taken + batch) + random.uniform(-reach, reach, (batch, 3))
        accepted.append(tried[inside(tried)])
        taken += batch
    return np.concatenate(accepted)[:count]
