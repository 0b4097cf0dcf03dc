"""Kernels of fits: velocities on a periodic grid and their derivatives, and distances in solids.

A padded grid has (N + 3)³ nodes × 3 numbers in one row: node i along an axis stands at i − 1, so that the
four nodes around each of the N³ cells are neighbours in memory. Between nodes the velocity is a Catmull-Rom
spline along each axis, as that of `external_kernels.sampled`. Positions count in cells. Sums run in the order
of the points, whatever the number of threads.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats

Four = tuple[float, float, float, float]


@kernel("UniTuple(f8, 4)(f8)")
def weights(s: float) -> Four:
    """Return the weights of the four nodes around a cell at its coordinate s, 0 to 1."""
    return (
        s * (-0.5 + s * (1.0 - 0.5 * s)),
        1.0 + s * s * (1.5 * s - 2.5),
        s * (0.5 + s * (2.0 - 1.5 * s)),
        s * s * (0.5 * s - 0.5),
    )


@kernel("UniTuple(f8, 4)(f8)")
def slopes(s: float) -> Four:
    """Return the derivatives of `weights`."""
    return (
        -0.5 + s * (2.0 - 1.5 * s),
        s * (4.5 * s - 5.0),
        0.5 + s * (4.0 - 4.5 * s),
        s * (1.5 * s - 1.0),
    )


@kernel("void(f8[::1], i8, f8[:, ::1], f8[:, ::1])")
def velocities(grid: Floats, n: int, points: Floats, out: Floats) -> None:
    """Compute the velocities (P, 3) of a padded grid of n³ cells at points (P, 3)."""
    m = n + 3
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
        i, j, k = int(fx) % n, int(fy) % n, int(fz) % n
        wx, wy, wz = weights(x - fx), weights(y - fy), weights(z - fz)
        u, v, w = 0.0, 0.0, 0.0
        for a in range(4):
            for b in range(4):
                s = wx[a] * wy[b]
                at = 3 * (((i + a) * m + j + b) * m + k)
                s0, s1, s2, s3 = s * wz[0], s * wz[1], s * wz[2], s * wz[3]
                u += s0 * grid[at] + s1 * grid[at + 3] + s2 * grid[at + 6] + s3 * grid[at + 9]
                v += s0 * grid[at + 1] + s1 * grid[at + 4] + s2 * grid[at + 7] + s3 * grid[at + 10]
                w += s0 * grid[at + 2] + s1 * grid[at + 5] + s2 * grid[at + 8] + s3 * grid[at + 11]
        out[p, 0], out[p, 1], out[p, 2] = u, v, w


@kernel("void(f8[::1], i8, f8[:, ::1], f8[:, ::1], f8[:, :, ::1])")
def gradients(grid: Floats, n: int, points: Floats, out: Floats, gradient: Floats) -> None:
    """Compute velocities (P, 3) and their gradients (P, 3, 3) by cells: row c is that of component c."""
    m = n + 3
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
        i, j, k = int(fx) % n, int(fy) % n, int(fz) % n
        wx, wy, wz = weights(x - fx), weights(y - fy), weights(z - fz)
        dx, dy, dz = slopes(x - fx), slopes(y - fy), slopes(z - fz)
        for c in range(3):
            value, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
            for a in range(4):
                for b in range(4):
                    at = 3 * (((i + a) * m + j + b) * m + k) + c
                    row = (
                        wz[0] * grid[at] + wz[1] * grid[at + 3] + wz[2] * grid[at + 6] + wz[3] * grid[at + 9]
                    )
                    value += wx[a] * wy[b] * row
                    gx += dx[a] * wy[b] * row
                    gy += wx[a] * dy[b] * row
                    gz += (wx[a] * wy[b]) * (
                        dz[0] * grid[at] + dz[1] * grid[at + 3] + dz[2] * grid[at + 6] + dz[3] * grid[at + 9]
                    )
            out[p, c] = value
            gradient[p, c, 0], gradient[p, c, 1], gradient[p, c, 2] = gx, gy, gz


@kernel("void(f8[::1], i8, f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def pull_back(grid: Floats, n: int, points: Floats, force: Floats, spread: Floats, out: Floats) -> None:
    """Compute the derivatives of Σ force · velocity.

    grid, spread  padded grids; the derivatives by the nodes are added to `spread`
    force, out    (P, 3); `out` takes the derivatives by the points (P, 3)
    """
    m = n + 3
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        f, g, h = force[p, 0], force[p, 1], force[p, 2]
        fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
        i, j, k = int(fx) % n, int(fy) % n, int(fz) % n
        wx, wy, wz = weights(x - fx), weights(y - fy), weights(z - fz)
        dx, dy, dz = slopes(x - fx), slopes(y - fy), slopes(z - fz)
        gx, gy, gz = 0.0, 0.0, 0.0
        for a in range(4):
            for b in range(4):
                s = wx[a] * wy[b]
                at = 3 * (((i + a) * m + j + b) * m + k)
                q0 = f * grid[at] + g * grid[at + 1] + h * grid[at + 2]
                q1 = f * grid[at + 3] + g * grid[at + 4] + h * grid[at + 5]
                q2 = f * grid[at + 6] + g * grid[at + 7] + h * grid[at + 8]
                q3 = f * grid[at + 9] + g * grid[at + 10] + h * grid[at + 11]
                row = wz[0] * q0 + wz[1] * q1 + wz[2] * q2 + wz[3] * q3
                gx += dx[a] * wy[b] * row
                gy += wx[a] * dy[b] * row
                gz += s * (dz[0] * q0 + dz[1] * q1 + dz[2] * q2 + dz[3] * q3)
                s0, s1, s2, s3 = s * wz[0], s * wz[1], s * wz[2], s * wz[3]
                spread[at] += s0 * f
                spread[at + 1] += s0 * g
                spread[at + 2] += s0 * h
                spread[at + 3] += s1 * f
                spread[at + 4] += s1 * g
                spread[at + 5] += s1 * h
                spread[at + 6] += s2 * f
                spread[at + 7] += s2 * g
                spread[at + 8] += s2 * h
                spread[at + 9] += s3 * f
                spread[at + 10] += s3 * g
                spread[at + 11] += s3 * h
        out[p, 0], out[p, 1], out[p, 2] = gx, gy, gz


@kernel("void(f8[:, ::1], f8[:, ::1], i8[::1])")
def nearest_rows(rows: Floats, queries: Floats, out: np.ndarray) -> None:
    """Compute the index of the nearest of rows (R, C) to each query (Q, C), the first of equally near ones.

    Only rows whose first number is near enough are looked at: they ascend by it.
    """
    count, columns = rows.shape
    for q in range(len(queries)):
        start = np.searchsorted(rows[:, 0], queries[q, 0])
        best, found, below, above = math.inf, -1, start - 1, start
        while below >= 0 or above < count:
            for side in range(2):
                r = below if side == 0 else above
                if r < 0 or r >= count:
                    continue
                d2 = (rows[r, 0] - queries[q, 0]) ** 2
                if d2 > best:
                    if side == 0:
                        below = -1
                    else:
                        above = count
                    continue
                for c in range(1, columns):
                    d2 += (rows[r, c] - queries[q, c]) ** 2
                    if d2 > best:
                        break
                if d2 < best or (d2 == best and r < found):
                    best, found = d2, r
                if side == 0:
                    below -= 1
                else:
                    above += 1
        out[q] = found


@kernel("void(f8[::1], f8[::1], f8, f8[::1])")
def blend(first: Floats, second: Floats, share: float, out: Floats) -> None:
    """Compute a mixture (N,) of two grids, with that share of the second."""
    for i in range(len(out)):
        out[i] = (1.0 - share) * first[i] + share * second[i]


@kernel("void(f8[::1], f8, f8[::1], f8[::1])")
def blend_back(mixed: Floats, share: float, first: Floats, second: Floats) -> None:
    """Add the derivatives by a mixture of `blend` (N,) to those by its two grids, and set `mixed` to 0."""
    for i in range(len(mixed)):
        value = mixed[i]
        first[i] += (1.0 - share) * value
        second[i] += share * value
        mixed[i] = 0.0


@kernel("f8(f8, f8, f8, f8)")
def arrival(a: float, b: float, c: float, h: float) -> float:
    """Return u with |∇u| = 1 at a node whose nearest neighbours along the axes, h away, have a, b and c.

    Source: Zhao, *A fast sweeping method for Eikonal equations*, Mathematics of Computation 74 (2005).
    """
    if a > b:
        a, b = b, a
    if b > c:
        b, c = c, b
    if a > b:
        a, b = b, a
    u = a + h
    if u > b:
        u = 0.5 * (a + b + math.sqrt(max(2.0 * h * h - (a - b) ** 2, 0.0)))
        if u > c:
            total = a + b + c
            u = (total + math.sqrt(max(total**2 - 3.0 * (a * a + b * b + c * c - h * h), 0.0))) / 3.0
    return u


@kernel("void(f8[:, :, ::1], b1[:, :, ::1], f8)")
def sweep(u: Floats, is_open: np.ndarray, h: float) -> None:
    """Lower u (N, N, N) at open nodes to the distance, through open nodes, from where it is lower already."""
    n = u.shape[0]
    idle = 0
    for turn in range(8 * n):
        is_idle = True
        for a in range(1, n - 1):
            i = a if turn & 1 else n - 1 - a
            for b in range(1, n - 1):
                j = b if turn & 2 else n - 1 - b
                for c in range(1, n - 1):
                    k = c if turn & 4 else n - 1 - c
                    if is_open[i, j, k]:
                        new = arrival(
                            min(u[i - 1, j, k], u[i + 1, j, k]),
                            min(u[i, j - 1, k], u[i, j + 1, k]),
                            min(u[i, j, k - 1], u[i, j, k + 1]),
                            h,
                        )
                        if new < u[i, j, k]:
                            is_idle = is_idle and new > u[i, j, k] - 1e-6
                            u[i, j, k] = new
        idle = idle + 1 if is_idle else 0
        if idle == 8:
            break


@kernel("b1(b1[::1])")
def is_simple(filled: np.ndarray) -> bool:
    """Tell whether a node can be taken from a solid without a change of the solid's topology.

    filled  (27,) of the node's neighbours, i · 9 + j · 3 + k; they are connected by faces, edges and corners,
            what is empty by faces

    Source: Bertrand, Malandain, *A new characterization of three-dimensional simple points*, Pattern
    Recognition Letters 15 (1994).
    """
    waiting, seen = np.empty(27, np.int64), np.zeros(27, np.bool_)
    for solid in range(2):
        parts = 0
        for first in range(27):
            i, j, k = first // 9 - 1, first // 3 % 3 - 1, first % 3 - 1
            size = abs(i) + abs(j) + abs(k)
            if size == 0 or seen[first] or filled[first] != (solid == 1) or (solid == 0 and size != 1):
                continue
            parts += 1
            if parts > 1:
                return False
            waiting[0], count = first, 1
            seen[first] = True
            while count:
                count -= 1
                at = waiting[count]
                i, j, k = at // 9 - 1, at // 3 % 3 - 1, at % 3 - 1
                for other in range(27):
                    a, b, c = other // 9 - 1, other // 3 % 3 - 1, other % 3 - 1
                    size = abs(a) + abs(b) + abs(c)
                    if size == 0 or seen[other] or filled[other] != (solid == 1) or (solid == 0 and size > 2):
                        continue
                    near = max(abs(a - i), abs(b - j), abs(c - k)) == 1
                    if near and (solid == 1 or abs(a - i) + abs(b - j) + abs(c - k) == 1):
                        seen[other] = True
                        waiting[count] = other
                        count += 1
        if parts == 0:
            return False
    return True


@kernel("void(f8[:, :, ::1], b1[:, :, ::1])")
def thin(depth: Floats, filled: np.ndarray) -> None:
    """Take nodes from a solid, the least deep ones first, as long as its topology stays.

    What is left of a solid without holes is one node, of others loops around the holes.
    """
    n = depth.shape[0]
    around = np.zeros(27, np.bool_)
    queue = [(0.0, np.int64(-1))]
    for i in range(1, n - 1):
        for j in range(1, n - 1):
            for k in range(1, n - 1):
                if filled[i, j, k]:
                    queue.append((depth[i, j, k], np.int64((i * n + j) * n + k)))
    heapq.heapify(queue)
    reached = 0.0
    while queue:
        least, at = heapq.heappop(queue)
        reached = max(reached, least)
        if at < 0:
            continue
        i, j, k = at // (n * n), at // n % n, at % n
        if not filled[i, j, k]:
            continue
        for other in range(27):
            around[other] = filled[i + other // 9 - 1, j + other // 3 % 3 - 1, k + other % 3 - 1]
        if not is_simple(around):
            continue
        filled[i, j, k] = False
        for other in range(27):
            a, b, c = i + other // 9 - 1, j + other // 3 % 3 - 1, k + other % 3 - 1
            if filled[a, b, c] and depth[a, b, c] <= reached:  # deeper ones wait in the queue
                heapq.heappush(queue, (depth[a, b, c], np.int64((a * n + b) * n + c)))


@kernel("void(f8[:, :, :, ::1], f8[:, :, ::1], i8[::1])")
def extend(values: Floats, signed: Floats, order: np.ndarray) -> None:
    """Copy values (N, N, N, K) to nodes, in this order, from the neighbour with the least signed distance."""
    n = signed.shape[0]
    for at in order:
        i, j, k = at // (n * n), at // n % n, at % n
        least, a, b, c = signed[i, j, k], i, j, k
        for other in range(27):
            p, q, r = i + other // 9 - 1, j + other // 3 % 3 - 1, k + other % 3 - 1
            if 0 <= p < n and 0 <= q < n and 0 <= r < n and signed[p, q, r] < least:
                least, a, b, c = signed[p, q, r], p, q, r
        for m in range(values.shape[3]):
            values[i, j, k, m] = values[a, b, c, m]
