"""Paths of velocities that carry points, fitted to data: large deformation diffeomorphic metric mapping.

A path v(x, t), t from 0 to 1, carries points by dx/dt = v(x, t). Of all paths a fit looks for that with

    E(v) = D(x(1)) + λ ∫ ‖v(·, t)‖² dt,    ‖v‖² = Σ (1 + ℓ² |ξ|²)³ (|v̂(ξ)|² + α |v̂(ξ) · ξ|² / |ξ|²)

D measures how far the carried points are from where they should be, and the norm makes the mapping from x(0)
to x(1) smooth with a smooth inverse: no two points meet, whatever the data (Dupuis, Grenander, Miller,
*Variational problems on flows of diffeomorphisms for image matching*, Quarterly of Applied Mathematics 56,
1998). Its second part (ours) makes it dear to squeeze or swell a small place: a limb draws its surface from
around, where otherwise volumes shrank to a thousandth. With v̂ = (1 + ℓ² |ξ|²)^(−3/2) û, û the numbers z with
their part along ξ divided by √(1 + α), the second term is λ ∫ |z|² dt; z is what L-BFGS changes.

Source: Beg, Miller, Trouvé, Younes, *Computing large deformation metric mappings via geodesic flows of
diffeomorphisms*, International Journal of Computer Vision 61 (2005). Ours: the grid of Catmull-Rom splines,
whose discrete adjoint gives exact gradients, so that the fitted map is the one that is played.

Space is the periodic unit cube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.become import fit_kernels as kernels

KNOTS = 5
"""Times of the path, evenly from 0 to 1; between them velocities are blended."""

STEPS = 16
"""Steps of the midpoint rule."""

SQUEEZE = 10.0
"""α: how much more a velocity costs that squeezes and swells than one that only shears."""

WINDOW = 0.04, 0.2
"""Of windowed paths: how near the sides of the cube velocities are 0, and from where on they are whole."""

BAND = 0.42
"""The highest frequency over the number of cells: a spline through fewer nodes a wave is none of its own."""

Data = Callable[[Floats], tuple[float, Floats]]
"""D of carried points (P, 3), and its derivatives (P, 3)."""


@dataclass(frozen=True)
class PathSpace:
    """The paths on a grid of n³ cells, by the real numbers z of their û.

    length       ℓ, over which velocities vary
    is_windowed  True where velocities fade to 0 at the sides of the cube, as WINDOW says
    """

    n: int
    length: float
    is_windowed: bool = False

    @property
    def _depth(self) -> int:
        """How many frequencies the half spectrum has along the last axis: the others are 0."""
        return int(BAND * self.n) + 1

    @cached_property
    def _modes(self) -> tuple[np.ndarray, np.ndarray, Floats]:
        """Flat indices (M,) into the half spectrum, wave numbers (M, 3), and factors (M,) from û to v̂."""
        n = self.n
        wave = np.fft.fftfreq(n, 1.0 / n)
        waves = np.stack(np.meshgrid(wave, wave, np.arange(float(self._depth)), indexing="ij"), axis=-1)
        waves = waves.reshape(-1, 3)
        kept = np.flatnonzero((waves**2).sum(axis=1) <= (BAND * n) ** 2)
        waves = waves[kept]
        filtered = (1.0 + (2.0 * np.pi * self.length) ** 2 * (waves**2).sum(axis=1)) ** -1.5
        twice = np.where(waves[:, 2] > 0.0, np.sqrt(0.5), 1.0)  # z is scaled so that |z|² is the norm
        return kept, waves, filtered * twice

    @cached_property
    def _window(self) -> Floats | float:
        """Factors (n, n, n) on velocities."""
        if not self.is_windowed:
            return 1.0
        at, (none, whole) = np.arange(self.n) / self.n, WINDOW
        share = np.clip((np.minimum(at, 1.0 - at) - none) / (whole - none), 0.0, 1.0)
        along = share * share * (3.0 - 2.0 * share)
        return along[:, None, None] * along[:, None] * along

    @cached_property
    def _time_weights(self) -> Floats:
        """(KNOTS,) the trapezoidal rule."""
        weights = np.full(KNOTS, 1.0 / (KNOTS - 1))
        weights[[0, -1]] *= 0.5
        return weights

    @cached_property
    def _headings(self) -> Floats:
        """Directions (3, M) in which the waves travel; 0 for the constant one."""
        waves = self._modes[1]
        return np.ascontiguousarray((waves / np.sqrt(np.maximum((waves**2).sum(axis=1), 1.0))[:, None]).T)

    def _less_squeezed(self, spectrum: np.ndarray) -> np.ndarray:
        """Return a spectrum (KNOTS, 3, M) with less of its parts along the waves: û of z."""
        along = (spectrum * self._headings).sum(axis=1, keepdims=True)
        along *= (1.0 + SQUEEZE) ** -0.5 - 1.0
        return spectrum + along * self._headings

    @property
    def size(self) -> int:
        """How many numbers z has."""
        return KNOTS * 3 * len(self._modes[0]) * 2

    def knots(self, z: Floats) -> Floats:
        """Return the velocities (KNOTS, 3, n, n, n) of a path."""
        n = self.n
        kept, _, factor = self._modes
        spectrum = np.zeros((KNOTS, 3, n * n * self._depth), np.complex128)
        scale = factor / np.sqrt(self._time_weights)[:, None, None]
        spectrum[:, :, kept] = self._less_squeezed(z.view(np.complex128).reshape(KNOTS, 3, -1)) * scale
        lines = np.fft.ifftn(spectrum.reshape(KNOTS, 3, n, n, -1), axes=(2, 3), norm="forward")
        return self._window * np.fft.irfft(lines, n=n, axis=4, norm="forward")

    def derivatives(self, by_knots: Floats) -> Floats:
        """Return derivatives by z from those by the velocities (KNOTS, 3, n, n, n)."""
        kept, waves, factor = self._modes
        lines = np.fft.rfft(self._window * by_knots, axis=4)[..., : self._depth]
        spectrum = np.fft.fftn(lines, axes=(2, 3)).reshape(KNOTS, 3, -1)[:, :, kept]
        spectrum *= factor / np.sqrt(self._time_weights)[:, None, None] * np.where(waves[:, 2] > 0, 2.0, 1.0)
        return np.ascontiguousarray(self._less_squeezed(spectrum)).view(np.float64).ravel()

    def converted(self, z: Floats, into: PathSpace) -> Floats:
        """Return the numbers of the same path, without the frequencies that it lacks, in another space."""
        _, waves, factor = self._modes
        _, others, other_factor = into._modes
        base = 4 * max(self.n, into.n)
        key, other_key = ((w + base) @ [base**2 * 4, base * 2, 1] for w in (waves, others))
        order = np.argsort(key)
        at = np.minimum(np.searchsorted(key[order], other_key), len(key) - 1)
        found = key[order][at] == other_key
        out = np.zeros((KNOTS, 3, len(others)), np.complex128)
        source = order[at[found]]
        values = z.view(np.complex128).reshape(KNOTS, 3, -1)[:, :, source]
        out[:, :, found] = values * (factor[source] / other_factor[found])
        return out.view(np.float64).ravel()


def padded(knots: Floats) -> Floats:
    """Return padded grids (T, (n + 3)³ · 3) of velocities (T, 3, n, n, n)."""
    grids = np.pad(knots.transpose(0, 2, 3, 4, 1), ((0, 0), (1, 2), (1, 2), (1, 2), (0, 0)), mode="wrap")
    return grids.reshape(len(knots), -1)


def _unpad(grids: Floats, n: int) -> Floats:
    """Return the sums (T, 3, n, n, n) of the numbers of a node in padded grids, which change."""
    m = n + 3
    sums = grids.reshape(-1, m, m, m, 3)
    for axis in (1, 2, 3):
        nodes = np.moveaxis(sums, axis, 0)
        nodes[n] += nodes[0]
        nodes[1] += nodes[n + 1]
        nodes[2] += nodes[n + 2]
        sums = np.moveaxis(nodes[1 : n + 1], 0, axis)
    return np.ascontiguousarray(sums.transpose(0, 4, 1, 2, 3))


def _knot_before(knots: int, time: float) -> tuple[int, float]:
    """Return the knot before a time from 0 to 1, and how much the next one counts."""
    at = time * (knots - 1)
    k = min(int(at), knots - 2)
    return k, at - k


def _blend(grids: Floats, time: float, memory: Floats) -> Floats:
    """Return the velocities at a time from 0 to 1: a knot, or a mixture of two in `memory`."""
    k, share = _knot_before(len(grids), time)
    if share == 0.0:
        return grids[k]
    kernels.blend(grids[k], grids[k + 1], share, memory)
    return memory


def carried(grids: Floats, n: int, points: Floats, steps: int = STEPS, backwards: bool = False) -> Floats:
    """Return where padded grids (T, …) carry points (P, 3) from time 0 to 1, or from 1 to 0."""
    x = points * n
    v, h = np.empty_like(x), (-n if backwards else n) / steps
    memory = np.empty_like(grids[0])
    for step in range(steps):
        at = (step, step + 0.5)
        begin, middle_time = (1.0 - a / steps if backwards else a / steps for a in at)
        kernels.velocities(_blend(grids, begin, memory), n, x, v)
        middle = x + 0.5 * h * v
        kernels.velocities(_blend(grids, middle_time, memory), n, middle, v)
        x = x + h * v
    return x / n


def carried_with_jacobians(grids: Floats, n: int, points: Floats) -> tuple[Floats, Floats]:
    """Return where points (P, 3) are carried, and the determinants (P,) of the mapping's gradient there."""
    x, jacobian, steps = points * n, np.tile(np.eye(3), (len(points), 1, 1)), 4 * STEPS
    v, gradient, h = np.empty_like(x), np.empty((len(x), 3, 3)), n / steps
    memory = np.empty_like(grids[0])
    for step in range(steps):
        kernels.gradients(_blend(grids, step / steps, memory), n, x, v, gradient)
        middle, between = x + 0.5 * h * v, jacobian + 0.5 * h * np.matmul(gradient, jacobian)
        kernels.gradients(_blend(grids, (step + 0.5) / steps, memory), n, middle, v, gradient)
        x, jacobian = x + h * v, jacobian + h * np.matmul(gradient, between)
    return x / n, np.linalg.det(jacobian)


def energy(
    space: PathSpace, z: Floats, points: Floats, data: Data, weight: float, steps: int = STEPS
) -> tuple[float, Floats]:
    """Return E of a path, and its derivatives by z.

    points  (P, 3), which the path carries to where `data` measures them
    weight  λ
    """
    n, h = space.n, space.n / steps
    grids = padded(space.knots(z))
    memory, spread = np.empty_like(grids[0]), np.zeros_like(grids[0])
    x, v = points * n, np.empty_like(points)
    starts, middles = [], []
    for step in range(steps):
        starts.append(x)
        kernels.velocities(_blend(grids, step / steps, memory), n, x, v)
        middle = x + 0.5 * h * v
        middles.append(middle)
        kernels.velocities(_blend(grids, (step + 0.5) / steps, memory), n, middle, v)
        x = x + h * v
    distance, force = data(x / n)
    force = force / n
    by_knots = np.zeros_like(grids)

    def pull(time: float, at: Floats, push: Floats) -> Floats:
        out = np.empty_like(at)
        kernels.pull_back(_blend(grids, time, memory), n, at, push, spread, out)
        k, share = _knot_before(len(grids), time)
        kernels.blend_back(spread, share, by_knots[k], by_knots[k + 1])
        return out

    for step in reversed(range(steps)):
        by_middle = pull((step + 0.5) / steps, middles[step], h * force)
        force = force + by_middle + pull(step / steps, starts[step], 0.5 * h * by_middle)
    derivatives = space.derivatives(_unpad(by_knots, n)) + 2.0 * weight * z
    return distance + weight * _dot(z, z), derivatives


def _dot(a: Floats, b: Floats) -> float:
    """Return a · b, summed in the same order by any number of threads, unlike BLAS."""
    return float(np.einsum("i,i->", a, b))


MEMORY = 6
"""Pairs of changes that L-BFGS keeps."""

FIRST_STEP, MOST_TRIES = 0.2, 14
"""The length of the first step, and how often a step is shortened. A long first step moves all at once, where
short ones would crumple what is near."""


Pair = tuple[Floats, Floats, float]
"""A change of z, that of the slope with it, and their product."""


def minimised(
    function: Callable[[Floats], tuple[float, Floats]],
    z: Floats,
    iterations: int,
    pairs: list[Pair],
) -> Floats:
    """Return z where a function is lower: limited-memory BFGS.

    pairs  the latest changes, which are replaced: empty at first, or those of a similar function

    It ends after some iterations, or when two in a row lower the function by less than a thousandth.

    Source: Liu, Nocedal, *On the limited memory BFGS method for large scale optimization*, Mathematical
    Programming 45 (1989). A step that does not lower the function enough (Armijo) is shortened to the lowest
    point of the parabola through what is known along it, but at most to a tenth.
    """
    value, slope = function(z)
    idle = 0
    for _ in range(iterations):
        direction = _downhill(slope, pairs)
        descent = _dot(direction, slope)
        if descent >= 0.0:
            break
        step = 1.0 if pairs else min(1.0, FIRST_STEP / np.sqrt(_dot(direction, direction)))
        for _ in range(MOST_TRIES):
            tried = z + step * direction
            new, new_slope = function(tried)
            if new <= value + 1e-4 * step * descent:
                break
            lowest = -0.5 * descent * step * step / (new - value - descent * step)
            step = min(max(lowest, 0.1 * step), 0.5 * step)
        else:
            break
        change, bend = tried - z, new_slope - slope
        if (product := _dot(change, bend)) > 1e-12 * _dot(change, change):
            pairs[:] = [*pairs, (change, bend, product)][-MEMORY:]
        idle = idle + 1 if value - new < 1e-3 * value else 0
        z, value, slope = tried, new, new_slope
        if idle == 2:
            break
    return z


def _downhill(slope: Floats, pairs: list[Pair]) -> Floats:
    """Return minus the approximate inverse Hessian times the slope: the two loops of L-BFGS.

    pairs  the latest changes of z and of the slope, and their products
    """
    direction, factors = -slope, []
    for s, y, product in reversed(pairs):
        factors.append(_dot(s, direction) / product)
        direction -= factors[-1] * y
    if pairs:
        _, y, product = pairs[-1]
        direction *= product / _dot(y, y)
    for (s, y, product), factor in zip(pairs, reversed(factors), strict=True):
        direction += (factor - _dot(y, direction) / product) * s
    return direction
