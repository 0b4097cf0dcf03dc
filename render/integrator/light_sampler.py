"""Light sampler: choose an emitter for next event estimation.

Mitsuba chooses all emitters equally often. Here an emitter is chosen with probability proportional to its
unoccluded irradiance at the shading point (compare pbrt's `LightSampler`), mixed with a small uniform part:
a glossy surface may reflect a faint emitter strongly. A gradient sky is left out: paths that the BSDF samples
find it best. Daylight and environment maps are sampled in two ways, as bright part and rest
(`render.integrator.sky_sampler`); the rest is sampled up to the first matt surface alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from render.integrator.scene_emitters import SampledEmitter, emitter_pointers

UNIFORM_FRACTION = 0.1
"""Fraction of the probability that is the same for all emitters."""

_MIN_SURFACE_COSINE, _MIN_EMITTER_COSINE = 0.05, 0.02
"""Least cosines used in estimates: emitters have a width, and glossy surfaces reflect at grazing angles."""


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
        import drjit as dr

        mine, others = vars(self).values(), vars(other).values()
        return LightSample(*(dr.select(where, new, old) for old, new in zip(mine, others, strict=True)))


class LightSource:
    """One way to sample an emitter: Mitsuba's, or a distribution of directions.

    described     the emitter
    emitter       pointer to it
    distribution  a `sky_sampler.Cone` or `sky_sampler.Table`, or None for Mitsuba's way
    is_rest       True for the rest of a sky, without its bright part
    """

    def __init__(
        self, described: SampledEmitter, emitter: Any, distribution: Any = None, is_rest: bool = False
    ) -> None:
        import mitsuba as mi

        self.emitter, self.distribution, self.is_rest = emitter, distribution, is_rest
        self.strength = _opaque(mi.Float, described.strength)
        self.position = _opaque(mi.Point3f, described.position)
        self.facing = _opaque(mi.Vector3f, described.facing)


class LightSampler:
    """Chooses among the light sources of a scene. Positions are data of the compiled code, not constants."""

    def __init__(self, scene: Any, sampled: Sequence[SampledEmitter]) -> None:
        import drjit as dr
        import mitsuba as mi

        self.sources: list[LightSource] = []
        pointers = emitter_pointers(scene, [each.name for each in sampled])
        for each, pointer in zip(sampled, pointers, strict=True):
            if each.strength is not None:
                self.sources.append(LightSource(each, pointer))
                continue
            bright, rest = _distributions(scene.environment(), each)
            if bright is not None:
                self.sources.append(LightSource(each, pointer, bright))
            self.sources.append(LightSource(each, pointer, rest, is_rest=bright is not None))
        box = scene.bbox()
        self._far = dr.opaque(mi.Float, 2.0 * float(dr.norm(box.extents())))

    def __len__(self) -> int:
        return len(self.sources)

    def probabilities(self, si: Any) -> list[Any]:
        """Return the probability of each light source at a surface interaction."""
        import drjit as dr
        import mitsuba as mi

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
        import drjit as dr
        import mitsuba as mi

        emitter = mi.EmitterPtr(self._near[0].emitter)
        for index, source in enumerate(self._near):
            emitter = dr.select(number == index, source.emitter, emitter)
        return _near_sample(emitter, si, position, 1.0, active)

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
        import drjit as dr

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
        import drjit as dr
        import mitsuba as mi

        chosen, cumulative = mi.UInt32(0), mi.Float(0.0)
        for index, probability in enumerate(probabilities):
            if not self.sources[index].is_rest:
                chosen = dr.select(number >= cumulative, index, chosen)
                cumulative += probability
        result: LightSample | None = None
        if self._near:
            emitter, probability = mi.EmitterPtr(self._near[0].emitter), probabilities[0]
            for index, source in enumerate(self._near):
                emitter = dr.select(chosen == index, source.emitter, emitter)
                probability = dr.select(chosen == index, probabilities[index], probability)
            is_near = active & (chosen < len(self._near))
            result = _near_sample(emitter, si, position, probability, is_near)
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
        import drjit as dr
        import mitsuba as mi

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
        import drjit as dr
        import mitsuba as mi

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
        import drjit as dr
        import mitsuba as mi

        square = mi.Float(0.0)
        for source, probability in zip(self.sources, probabilities, strict=True):
            if source.distribution is not None and not (
                isinstance(probability, float) and probability == 0.0
            ):
                square += dr.square(probability * source.distribution.pdf(direction))
        return square


def _near_sample(emitter: Any, si: Any, position: Any, probability: Any, active: Any) -> LightSample:
    """Sample a position in Mitsuba's way."""
    import drjit as dr

    sampled, light = emitter.sample_direction(si, position, active)
    density = sampled.pdf * probability
    light = dr.select(sampled.pdf != 0.0, light / probability, 0.0)
    return LightSample(emitter, sampled.d, sampled.p, light, density, dr.square(density), sampled.delta)


def _distributions(emitter: Any, described: SampledEmitter) -> tuple[Any, Any]:
    """Return the distributions of the bright part of a sky, or None, and of the rest."""
    from render.integrator import sky_sampler  # needs Mitsuba's variant

    if described.daylight is not None and not sky_sampler.is_map(emitter):
        return sky_sampler.sun_and_sky(emitter, described.daylight)
    return sky_sampler.bright_and_rest(emitter)


def _irradiance(si: Any, source: LightSource) -> Any:
    """Return the approximate unoccluded irradiance by an emitter, always above 0."""
    import drjit as dr

    if source.position is None:
        return source.strength * dr.maximum(dr.abs(dr.dot(source.facing, si.n)), _MIN_SURFACE_COSINE)
    difference = source.position - si.p
    square = dr.maximum(dr.squared_norm(difference), 1e-12)
    direction = difference * dr.rsqrt(square)
    cosine = dr.maximum(dr.abs(dr.dot(direction, si.n)), _MIN_SURFACE_COSINE)
    towards = dr.maximum(-dr.dot(direction, source.facing), _MIN_EMITTER_COSINE)
    return source.strength * towards * cosine / square


def _opaque(kind: Any, value: Any) -> Any:
    """Return a value as data of the compiled code, which would otherwise be compiled for each value."""
    import drjit as dr

    if value is None:
        return None
    data = kind(value)
    dr.make_opaque(data)
    return data
