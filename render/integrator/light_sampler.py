"""Light sampler: choose an emitter for next event estimation, and directions to it.

Mitsuba chooses all emitters equally often. Here an emitter is chosen with probability proportional to its
unoccluded irradiance at the shading point (compare pbrt's `LightSampler`), mixed with a small uniform part:
a glossy surface may reflect a faint emitter strongly. A gradient sky is left out: paths that the BSDF samples
find it best.

Daylight and environment maps are sampled in two ways. A sun gives most of the light from a hundred-thousandth
of the directions, and one distribution over all directions would send nearly all samples there, and too few
of them to the sky. So the bright part and the rest have distributions of their own, which multiple importance
sampling weighs against each other (Veach 1997). The rest is sampled up to the first matt surface alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.integrator.scene_emitters import emitter_pointers
from flowsculpt.render.scene.scene_lights import SampledEmitter
from flowsculpt.render.scene.sky import Daylight

UNIFORM_FRACTION = 0.1
"""Fraction of the probability that is the same for all emitters."""

_MIN_SURFACE_COSINE, _MIN_EMITTER_COSINE = 0.05, 0.02
"""Least cosines used in estimates: emitters have a width, and glossy surfaces reflect at grazing angles."""

MAX_COLUMNS, REST_COLUMNS = 2048, 128
"""Most columns of the table of bright directions, and columns of the table of the rest."""

BRIGHT = 2.0
"""Luminance from which a direction is bright, over the mean."""

LEAST_BRIGHT_FRACTION = 0.2
"""Least fraction of the light that makes a distribution of the bright part worth its shadow rays."""

_WIDENING = 1.01
"""Width of the cone of a sun over that of its disc: rounding never puts the rim outside."""

_RIM_SAMPLES = 1 << 18
"""Directions that measure a sun's disc."""

_TOGETHER = 1 << 20
"""Directions whose light is computed together."""

_GLARE = 0.01
"""Angle around a sun's disc that is not asked for the light of the sky, radians."""


@dataclass
class LightSample:
    """A sampled position on an emitter.

    emitter    pointer to it
    direction  unit vector to it
    target     the position, or a point far away
    light      radiance over `density`
    density    over directions, times the probability of the light source
    square     sum of the squared densities with which all light sources give the direction
    is_delta   True where the BSDF cannot give the direction
    """

    emitter: Any
    direction: Any
    target: Any
    light: Any
    density: Any
    square: Any
    is_delta: Any

    def replaced(self, where: Any, other: LightSample) -> LightSample:
        """Return the sample with another one in its place, where that was chosen."""
        mine, others = vars(self).values(), vars(other).values()
        return LightSample(*(dr.select(where, new, old) for old, new in zip(mine, others, strict=True)))


class LightSource:
    """One way to sample an emitter: Mitsuba's, or a distribution of directions.

    described     the emitter
    emitter       pointer to it
    distribution  a `Cone` or a `Table`, or None for Mitsuba's way
    is_rest       True for the rest of a sky, without its bright part
    """

    def __init__(
        self, described: SampledEmitter, emitter: Any, distribution: Any = None, is_rest: bool = False
    ) -> None:
        self.emitter, self.distribution, self.is_rest = emitter, distribution, is_rest
        self.strength = opaque(mi.Float, described.strength)
        self.position = opaque(mi.Point3f, described.position)
        self.facing = opaque(mi.Vector3f, described.facing)


class LightSampler:
    """Chooses among the light sources of a scene. Positions are data of the compiled code, not constants."""

    def __init__(self, scene: Any, sampled: Sequence[SampledEmitter]) -> None:
        self.sources: list[LightSource] = []
        pointers = emitter_pointers(scene, [each.name for each in sampled])
        for each, pointer in zip(sampled, pointers, strict=True):
            if each.strength is not None:
                self.sources.append(LightSource(each, pointer))
                continue
            bright, rest = sky_distributions(scene.environment(), each.daylight)
            if bright is not None:
                self.sources.append(LightSource(each, pointer, bright))
            self.sources.append(LightSource(each, pointer, rest, is_rest=bright is not None))
        box = scene.bbox()
        self._far = dr.opaque(mi.Float, 2.0 * float(dr.norm(box.extents())))

    def __len__(self) -> int:
        return len(self.sources)

    def probabilities(self, si: Any) -> list[Any]:
        """Return the probability of each light source at a surface interaction."""
        estimates = [None if source.strength is None else _irradiance(si, source) for source in self.sources]
        known = [estimate for estimate in estimates if estimate is not None]
        mean = sum(known) / len(known) if known else 1.0
        weights: list[Any] = [
            0.0 if source.is_rest else mean if estimate is None else estimate
            for source, estimate in zip(self.sources, estimates, strict=True)
        ]
        total: Any = dr.maximum(sum(weights, dr.zeros(mi.Float)), 1e-30)
        uniform = UNIFORM_FRACTION / max(1, sum(not source.is_rest for source in self.sources))
        return [
            0.0 if source.is_rest else (1.0 - UNIFORM_FRACTION) * weight / total + uniform
            for source, weight in zip(self.sources, weights, strict=True)
        ]

    def sample_each(self, number: Any, si: Any, position: Any, active: Any) -> LightSample:
        """Sample the light source of a number below `near_count`, as one of those that are all sampled."""
        return _near_sample(emitter_of(self._near, number), si, position, 1.0, active)

    def sample_distant(self, index: int, matt: Any, si: Any, position: Any, active: Any) -> LightSample:
        """Sample the light source of an index from `near_count` on, as one of those that are all sampled."""
        return self._sample(index, si, position, self.expected_samples(matt, active), active)

    def expected_samples(
        self, matt: Any, are_all_sampled: Any, probabilities: Sequence[Any] | None = None
    ) -> list[Any]:
        """Return the expected number of samples of each light source at a vertex of a path.

        matt  matt surfaces that the path has left before

        Where all are sampled it is 1, but 0 for the rest of a sky beyond the first matt surface. Elsewhere it
        is the probability, or 0 without them.
        """
        counts = [dr.select(matt == 0, 1.0, 0.0) if source.is_rest else 1.0 for source in self.sources]
        others = probabilities or [0.0] * len(self)
        return [dr.select(are_all_sampled, one, other) for one, other in zip(counts, others, strict=True)]

    @property
    def near_count(self) -> int:
        """The number of light sources that Mitsuba samples; they come first."""
        return len(self._near)

    def sample_one(
        self, si: Any, probabilities: list[Any], number: Any, position: Any, active: Any
    ) -> LightSample:
        """Sample a light source that is chosen by a random number from 0 to 1, by two more of them."""
        chosen, cumulative = mi.UInt32(0), mi.Float(0.0)
        for index, probability in enumerate(probabilities):
            if not self.sources[index].is_rest:
                chosen = dr.select(number >= cumulative, index, chosen)
                cumulative += probability
        result: LightSample | None = None
        if self._near:
            probability = probabilities[0]
            for index in range(len(self._near)):
                probability = dr.select(chosen == index, probabilities[index], probability)
            is_near = active & (chosen < len(self._near))
            result = _near_sample(emitter_of(self._near, chosen), si, position, probability, is_near)
        for index in range(len(self._near), len(self)):
            if not self.sources[index].is_rest:
                is_chosen = active & (chosen == index)
                sample = self._sample(index, si, position, probabilities, is_chosen)
                result = sample if result is None else result.replaced(is_chosen, sample)
        assert result is not None
        return result

    def squared_density(self, si: Any, hit: Any, probabilities: list[Any], active: Any) -> Any:
        """Return the sum of the squared densities with which light sources give a direction that a path took.

        hit  Mitsuba's direction sample of what the path hit
        """
        square = mi.Float(0.0)
        if self._near:
            probability = mi.Float(0.0)
            for source, its_probability in zip(self._near, probabilities, strict=False):
                probability = dr.select(hit.emitter == source.emitter, its_probability, probability)
            active = active & (probability > 0.0)
            square = dr.square(probability * hit.emitter.pdf_direction(si, hit, active))
        if len(self._near) < len(self):
            is_sky = hit.emitter == self.sources[-1].emitter
            square = dr.select(is_sky, self._distant_square(hit.d, probabilities), square)
        return square

    @property
    def _near(self) -> list[LightSource]:
        """Light sources that Mitsuba samples; they come first."""
        return [source for source in self.sources if source.distribution is None]

    def _sample(
        self, index: int, si: Any, position: Any, probabilities: Sequence[Any], active: Any
    ) -> LightSample:
        """Sample one light source."""
        source, probability = self.sources[index], probabilities[index]
        if source.distribution is None:
            return _near_sample(source.emitter, si, position, probability, active)
        direction, density = source.distribution.sample(position)
        sky = dr.zeros(mi.SurfaceInteraction3f)
        sky.wi = -direction
        density = density * probability
        light = source.emitter.eval(sky, active) * (source.distribution.correction / density)
        light = dr.select(density > 0.0, light, 0.0)
        square = dr.maximum(self._distant_square(direction, probabilities), dr.square(density))
        return LightSample(
            source.emitter, direction, si.p + direction * self._far, light, density, square, mi.Bool(False)
        )

    def _distant_square(self, direction: Any, probabilities: Sequence[Any]) -> Any:
        """Return the sum of the squared densities with which distributions give a direction."""
        square = mi.Float(0.0)
        for source, probability in zip(self.sources, probabilities, strict=True):
            if source.distribution is not None and not (
                isinstance(probability, float) and probability == 0.0
            ):
                square += dr.square(probability * source.distribution.pdf(direction))
        return square


def emitter_of(sources: Sequence[LightSource], number: Any) -> Any:
    """Return the emitters of sources, by an array of their numbers."""
    emitter = mi.EmitterPtr(sources[0].emitter)
    for index, source in enumerate(sources):
        emitter = dr.select(number == index, source.emitter, emitter)
    return emitter


def _near_sample(emitter: Any, si: Any, position: Any, probability: Any, active: Any) -> LightSample:
    """Sample a position in Mitsuba's way."""
    sampled, light = emitter.sample_direction(si, position, active)
    density = sampled.pdf * probability
    light = dr.select(sampled.pdf != 0.0, light / probability, 0.0)
    return LightSample(emitter, sampled.d, sampled.p, light, density, dr.square(density), sampled.delta)


def _irradiance(si: Any, source: LightSource) -> Any:
    """Return the approximate unoccluded irradiance by an emitter, always above 0."""
    if source.position is None:
        return source.strength * dr.maximum(dr.abs(dr.dot(source.facing, si.n)), _MIN_SURFACE_COSINE)
    difference = source.position - si.p
    square = dr.maximum(dr.squared_norm(difference), 1e-12)
    direction = difference * dr.rsqrt(square)
    cosine = dr.maximum(dr.abs(dr.dot(direction, si.n)), _MIN_SURFACE_COSINE)
    towards = dr.maximum(-dr.dot(direction, source.facing), _MIN_EMITTER_COSINE)
    return source.strength * towards * cosine / square


class Cone:
    """Equal density in all directions of a sun's disc.

    direction  unit vector to the sun
    width      angular diameter, radians
    emitter    Mitsuba's daylight
    """

    def __init__(self, direction: Triple, width: float, emitter: Any) -> None:
        height = 1.0 - math.cos(_WIDENING * width / 2.0)
        self._axis = opaque(mi.Vector3f, direction)
        self._height = opaque(mi.Float, height)
        self._density = opaque(mi.Float, 1.0 / (2.0 * math.pi * height))
        self.correction = opaque(mi.Float, self._correction(emitter, width))

    def _correction(self, emitter: Any, width: float) -> float:
        """Return the area of the disc by Mitsuba's samples over that by its radiance.

        Mitsuba finds the rim in single precision, which makes both differ by up to 0.4%.
        """
        numbers = np.arange(_RIM_SAMPLES)
        places = (numbers + 0.5) / _RIM_SAMPLES, numbers * ((math.sqrt(5.0) - 1.0) / 2.0) % 1.0
        direction, _ = self.sample(mi.Point2f(*(place.astype(np.float32) for place in places)))
        si = dr.zeros(mi.SurfaceInteraction3f, _RIM_SAMPLES)
        si.wi = -direction
        light = np.array(mi.luminance(emitter.eval(si)))
        inside = float((light > 0.1 * light.max()).mean())
        if inside > 1.0 - (_WIDENING - 1.0) / 2.0 or not light.any():
            return 1.0  # the sun is off, or all is
        rounded = float(np.float32(1.0) - np.cos(np.float32(width / 2.0)))
        return rounded / (inside * (1.0 - math.cos(_WIDENING * width / 2.0)))

    def sample(self, position: Any) -> tuple[Any, Any]:
        """Return a direction and its density, by two numbers from 0 to 1."""
        disc = mi.warp.square_to_uniform_disk_concentric(position)
        depth = dr.squared_norm(disc) * self._height  # 1 - cosine, which keeps its digits
        factor = dr.sqrt(self._height * (2.0 - depth))  # from a radius on the disc to the sine of the angle
        local = mi.Vector3f(disc.x * factor, disc.y * factor, 1.0 - depth)
        return mi.Frame3f(self._axis).to_world(local), self._density

    def pdf(self, direction: Any) -> Any:
        """Return the density of a direction."""
        depth = 0.5 * dr.squared_norm(direction - self._axis)
        return dr.select(depth <= self._height, self._density, 0.0)


class Table:
    """Density by a table of luminances.

    Rows go from the zenith to the nadir, columns from +z towards +x and on to +z again. The density is above
    0 everywhere.
    """

    def __init__(self, luminance: NDArray[np.float64]) -> None:
        if not luminance.any():
            luminance = np.ones_like(luminance)  # a sky that is turned off still has a density
        sine = np.sin(np.linspace(0.0, math.pi, len(luminance)))
        weights = np.maximum(luminance, 1e-4 * luminance.mean()) * np.maximum(sine, 0.25 * sine[1])[:, None]
        self.correction = 1.0
        self._warp: Any = mi.Hierarchical2D0(
            np.ascontiguousarray(weights, dtype=np.float32), [], normalize=True
        )

    def sample(self, position: Any) -> tuple[Any, Any]:
        """Return a direction and its density, by two numbers from 0 to 1."""
        uv, density = self._warp.sample(position)
        sine, cosine = dr.sincos(uv.y * math.pi)
        across, along = dr.sincos(uv.x * (2.0 * math.pi))
        return mi.Vector3f(sine * across, cosine, sine * along), density * _jacobian(sine)

    def pdf(self, direction: Any) -> Any:
        """Return the density of a direction."""
        turn = dr.atan2(direction.x, direction.z) * (0.5 / math.pi)
        uv = mi.Point2f(turn - dr.floor(turn), dr.safe_acos(direction.y) / math.pi)
        return self._warp.eval(uv) * _jacobian(dr.safe_sqrt(1.0 - direction.y * direction.y))


def _jacobian(sine: Any) -> Any:
    """Return the density over directions for a density of 1 in the table."""
    return dr.select(sine > 1e-5, dr.rcp(2.0 * math.pi**2 * sine), 0.0)


_latest: dict[Daylight, tuple[Cone, Table]] = {}
"""Distributions of the latest daylight, which most frames of a shot share: to measure them takes as long as
ten thousand paths."""


def sky_distributions(emitter: Any, daylight: Daylight | None) -> tuple[Cone | Table | None, Table]:
    """Return the distributions of the bright part of a sky, or None, and of the rest.

    emitter   Mitsuba's; an environment map without daylight, and for one in a working space that Mitsuba's
              sky lacks
    daylight  that it is, or None
    """
    if daylight is None or "data" in mi.traverse(emitter):
        return _bright_and_rest(emitter)
    found = _latest.get(daylight)
    if found is None:
        found = _sun_and_sky(emitter, daylight)
        _latest.clear()
        _latest[daylight] = found
    return found


def _sun_and_sky(emitter: Any, daylight: Daylight) -> tuple[Cone, Table]:
    """Measure the distributions of a sun's disc, and of the sky around it. emitter: Mitsuba's daylight"""
    direction, width = daylight.direction, daylight.width
    luminance = _luminance(emitter, REST_COLUMNS)
    near = _directions(REST_COLUMNS, slice(None)) @ np.array(direction) > math.cos(width / 2.0 + _GLARE)
    luminance[near] = luminance[~near].max()
    return Cone(direction, width, emitter), Table(_dilate(luminance))


def _bright_and_rest(emitter: Any) -> tuple[Table | None, Table]:
    """Return the distributions of the bright part of an environment map, or None, and of the rest."""
    columns = int(mi.traverse(emitter)["data"].shape[1])
    kept = min(MAX_COLUMNS, 1 << (columns - 1).bit_length())
    luminance = _luminance(emitter, kept * max(2, columns // kept))
    area = np.sin(np.linspace(0.0, math.pi, len(luminance)))[:, None] * np.ones(luminance.shape[1])
    limit = BRIGHT * float(np.average(luminance, weights=area))
    excess = np.maximum(luminance - limit, 0.0)
    rest = Table(_coarser(luminance - excess, REST_COLUMNS))
    if (excess * area).sum() < LEAST_BRIGHT_FRACTION * (luminance * area).sum():
        return None, Table(_coarser(luminance, kept))
    return Table(_coarser(excess, kept)), rest


def _directions(columns: int, rows: slice) -> NDArray[np.float64]:
    """Return the directions (rows, columns + 1, 3) of some rows of a table, which has columns / 2 + 1."""
    tilt = np.linspace(0.0, math.pi, columns // 2 + 1)[rows, None]
    turn = np.linspace(0.0, 2.0 * math.pi, columns + 1)
    parts = np.sin(tilt) * np.sin(turn), np.cos(tilt), np.sin(tilt) * np.cos(turn)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _luminance(emitter: Any, columns: int) -> NDArray[np.float64]:
    """Return the luminance of a distant emitter for the entries (columns / 2 + 1, columns + 1) of a table."""
    luminance = np.empty((columns // 2 + 1, columns + 1))
    step = max(1, _TOGETHER // columns)
    for first in range(0, len(luminance), step):
        rows = slice(first, first + step)
        directions = _directions(columns, rows).reshape(-1, 3)
        si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
        si.wi = -mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32))
        luminance[rows] = np.array(mi.luminance(emitter.eval(si))).reshape(-1, columns + 1)
    return luminance


def _coarser(values: NDArray[np.float64], columns: int) -> NDArray[np.float64]:
    """Return means of a table around the entries of one with fewer columns."""
    step = max(1, (values.shape[1] - 1) // columns)
    if step == 1:
        return values
    rows = (len(values) - 1) // step
    cells = values[:-1, :-1].reshape(rows, step, -1, step).mean(axis=(1, 3))
    cells = np.pad(np.pad(cells, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    return np.asarray((cells[1:, 1:] + cells[:-1, 1:] + cells[1:, :-1] + cells[:-1, :-1]) / 4.0)


def _dilate(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the greatest of each entry and its eight neighbours: the light ends at the horizon."""
    padded = np.pad(np.pad(values, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    across = np.maximum(np.maximum(padded[:, 2:], padded[:, :-2]), padded[:, 1:-1])
    return np.asarray(np.maximum(np.maximum(across[2:], across[:-2]), across[1:-1]))


def opaque(kind: Any, value: Any) -> Any:
    """Return a value as data of the compiled code, else compiled for each; None stays."""
    if value is None:
        return None
    data = kind(value)
    dr.make_opaque(data)
    return data
