"""The path tracer, in code that Dr.Jit compiles.

Path tracing with next event estimation and multiple importance sampling (Veach 1997). It computes the same
light as Mitsuba's `path` with less noise: random numbers continue one sequence from batch to batch
(`render.integrator.sampler`), emitters are chosen by their irradiance, and at the first vertices all of them
are sampled (`render.integrator.light_sampler`). The samples of a pixel are taken one after the other, so that
sums have a fixed order.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.integrator.emitter_groups import EmitterGroups
from render.integrator.light_sampler import LightSample, LightSampler
from render.integrator.sampler import (
    DIRECTION,
    EMITTER_CHOICE,
    EMITTER_POSITION,
    LENS,
    LOBE,
    PIXEL,
    OwenSampler,
)
from render.integrator.subsurface import SubsurfaceWalk, random_bits

MAX_SAMPLED_TOGETHER, ALL_SAMPLED_VERTICES = 6, 2
"""Most emitters that are all sampled at the first vertices of a path, and the number of these vertices. With
more emitters, one is chosen there too."""

SURVIVAL_FACTOR = 4.0
"""Probability that a path goes on after those vertices, over its throughput (Russian roulette)."""


@dataclass(frozen=True, eq=False)
class ShadowCatcher:
    """A shape that the lens does not see, but the shadows on it.

    shape  pointer to it
    empty  path tracer of a scene with this shape and the emitters alone
    """

    shape: Any
    empty: PathTracer


@dataclass(frozen=True, eq=False)
class PathTracer:
    """A path tracer for one scene.

    integrator     Mitsuba's, which is used only to look past hidden emitters
    max_depth      vertices of a path, the emitter's included
    hide_emitters  True if the lens sees neither emitters nor the sky
    groups         light groups, each of which gets a sum of its own; by default one of all emitters
    objects        shapes whose coverage of the pixel is measured
    catcher        a shape that is not seen, but the shadows on it; or None
    subsurface     random walks below the subject's surface, or None
    caustic_sun    a `caustic_sun.CausticSun`, or None
    """

    scene: Any
    integrator: Any
    light_sampler: LightSampler
    max_depth: int
    hide_emitters: bool
    groups: EmitterGroups = field(default_factory=EmitterGroups)
    objects: Sequence[Any] = ()
    catcher: ShadowCatcher | None = None
    subsurface: SubsurfaceWalk | None = None
    caustic_sun: Any = None

    @property
    def coverage_channels(self) -> int:
        """The channels of alpha, the coverage of the objects, and light on the shadow catcher."""
        return 1 + len(self.objects) + (2 if self.catcher else 0)

    def render(
        self, samples: int, first: int, seed: int, pixels: NDArray[np.integer[Any]] | None = None
    ) -> NDArray[np.float64]:
        """Return radiance, luminance and its square, alpha and the coverage of each object, as means over
        samples.

        first   samples of the same pixels and seed that were taken before
        pixels  numbers of the pixels to sample, row by row from the upper left of the rendered part; None is
                all of them

        The result is (H, W, channels), or with `pixels` (pixels, channels). With light groups, three channels
        for each stand before alpha: its radiance. The samples of a pixel do not depend on which others are
        rendered.
        """
        film = self.scene.sensors()[0].film()
        number, corner, size = film_pixels(film, pixels)
        sums = _sum_samples(self, OwenSampler(number, first, samples, seed), corner, size)
        dr.eval(sums)
        picture = np.stack([np.array(channel, dtype=np.float64) for channel in sums], axis=1) / samples
        dr.flush_malloc_cache()
        width, height = (int(side) for side in film.crop_size())
        return picture if pixels is not None else picture.reshape(height, width, -1)


def film_pixels(film: Any, pixels: NDArray[np.integer[Any]] | None) -> tuple[Any, Any, Any]:
    """Return numbers of pixels in the whole picture, their upper left corners in the rendered part, and its
    size.

    pixels  as of `PathTracer.render`
    """
    (width, height), (left, top) = film.crop_size(), film.crop_offset()
    numbers = np.arange(int(width) * int(height)) if pixels is None else pixels
    index = mi.UInt32(numbers.astype(np.uint32))
    row = index // dr.opaque(mi.UInt32, int(width))
    column = index - row * int(width)
    number = (row + int(top)) * int(film.size()[0]) + column + int(left)
    return number, mi.Point2f(column, row), mi.Point2f(mi.ScalarPoint2f(film.crop_size()))


@dr.syntax
def _sum_samples(tracer: PathTracer, sampler: OwenSampler, corner: Any, size: Any) -> Any:
    """Return the sums over all samples, (pixels,) each.

    Radiance (3), luminance and its square, the radiance (3) of each light group, alpha, the coverage of each
    object, and the luminance on the shadow catcher with and without what casts shadows. Light that is not
    finite counts as black.
    """
    sample = mi.UInt32(0)
    radiance, luminance, square = mi.Color3f(0.0), mi.Float(0.0), mi.Float(0.0)
    groups = tracer.groups.zeros() if tracer.groups.are_wanted else []
    coverage = [mi.Float(0.0)] * tracer.coverage_channels
    while dr.hint(sample < sampler.count, label="samples", exclude=[tracer, sampler, corner, size]):
        sampler.sample = sample
        si, throughput = camera_vertex(tracer, sampler, corner, size)
        parts, caught = _beside_catcher(tracer, sampler, si, throughput)
        coverage = _plus(coverage, [*_seen(tracer, si), *caught])
        light = sum(parts[1:], parts[0])
        groups = _plus(groups, parts)
        y = mi.luminance(light)
        radiance += light
        luminance += y
        square += y * y
        sample += 1
    return [*radiance, luminance, square, *(channel for group in groups for channel in group), *coverage]


def _finite(parts: list[Any]) -> list[Any]:
    is_finite = dr.isfinite(mi.luminance(sum(parts[1:], parts[0])))
    return [dr.select(is_finite, part, 0.0) for part in parts]


def _plus(totals: list[Any], parts: list[Any]) -> list[Any]:
    return [total + part for total, part in zip(totals, parts, strict=False)]


def _seen(tracer: PathTracer, si: Any) -> list[Any]:
    """Return 1 or 0 for alpha and each object, by what the lens sees. A visible sky is opaque."""
    hit = si.is_valid() if tracer.hide_emitters else mi.Bool(True)
    if tracer.catcher is not None:
        hit &= ~_is_on(si, tracer.catcher.shape)
    objects = (dr.select(_is_on(si, shape), 1.0, 0.0) for shape in tracer.objects)
    return [dr.select(hit, 1.0, 0.0), *objects]


def _is_on(si: Any, shape: Any) -> Any:
    return si.is_valid() & (si.shape == shape)


def _beside_catcher(
    tracer: PathTracer, sampler: OwenSampler, si: Any, throughput: Any
) -> tuple[list[Any], list[Any]]:
    """Return the radiance by light group, 0 on the shadow catcher, and the luminance on the catcher with and
    without what casts shadows.

    Both paths on the catcher have the same random numbers: light that no shadow changes is the same to the
    last bit. Light that the subject adds, such as a caustic, is left out, sample by sample.
    """
    parts = _finite(trace(tracer, sampler, dr.copy(si), dr.copy(throughput)))  # tracing moves them along
    if tracer.catcher is None:
        return parts, []
    is_on = _is_on(si, tracer.catcher.shape)
    lit = dr.select(is_on, mi.luminance(sum(parts[1:], parts[0])), 0.0)
    bare = dr.copy(si)
    bare.t = dr.select(is_on, si.t, dr.inf)
    without = _finite(trace(tracer.catcher.empty, sampler, bare, dr.copy(throughput)))
    seen = [dr.select(is_on, 0.0, part) for part in parts]
    unshadowed = mi.luminance(sum(without[1:], without[0]))
    return seen, [dr.minimum(lit, unshadowed), unshadowed]


@dr.syntax
def trace(tracer: PathTracer, sampler: OwenSampler, si: Any, throughput: Any) -> Any:
    """Trace one path through each pixel from its first surface interaction, and return its radiance by light
    group."""
    groups, scene, light_sampler = tracer.groups, tracer.scene, tracer.light_sampler
    radiance = groups.zeros()
    if dr.hint(not tracer.hide_emitters, mode="scalar"):
        radiance = groups.add(radiance, throughput * si.emitter(scene).eval(si), si.emitter(scene), -si.wi)
    vertex, length, active = mi.UInt32(0), mi.UInt32(0), si.is_valid()
    subsurface: Any = tracer.subsurface
    is_exit = mi.Bool(False)
    after_matt = mi.Bool(False)
    sample_all = 0 < len(light_sampler) <= MAX_SAMPLED_TOGETHER
    while dr.hint(
        active,
        label="path",
        exclude=[tracer, sampler, groups, scene, light_sampler, sample_all, subsurface],
    ):
        bsdf = si.bsdf()
        if dr.hint(subsurface is not None, mode="scalar"):
            bsdf = subsurface.bsdf(si, is_exit)
        # Next event estimation: sample all emitters at the first vertices, and one emitter at later ones.
        probabilities = light_sampler.probabilities(si)
        are_all_sampled = sample_all & (vertex < ALL_SAMPLED_VERTICES)
        if dr.hint(sample_all, mode="scalar"):
            first = active & are_all_sampled
            radiance = _all_direct_light(tracer, sampler, vertex, si, bsdf, throughput, radiance, first)
        if dr.hint(len(light_sampler) > 0, mode="scalar"):
            wanted = active & ~are_all_sampled
            choice = sampler.vertex_1d(vertex, EMITTER_CHOICE)
            position = sampler.vertex_2d(vertex, EMITTER_POSITION)
            sample = light_sampler.sample_one(si, probabilities, choice, position, wanted)
            light = throughput * _direct_light(tracer, si, bsdf, sample, wanted)
            radiance = groups.add(radiance, light, sample.emitter, sample.direction)
        if dr.hint(sample_all, mode="scalar"):
            probabilities = light_sampler.expected_samples(vertex, are_all_sampled, probabilities)
        # Continue the path by the BSDF.
        lobe, direction = sampler.vertex_1d(vertex, LOBE), sampler.vertex_2d(vertex, DIRECTION)
        bsdf_sample, weight = bsdf.sample(mi.BSDFContext(), si, lobe, direction, active)
        throughput *= weight
        active &= dr.any(throughput != 0.0)
        way = si.to_world(bsdf_sample.wo)
        is_exit = mi.Bool(False)
        if dr.hint(subsurface is not None, mode="scalar"):
            is_exit = subsurface.enters(si, bsdf_sample, active)
        next_si = scene.ray_intersect(si.spawn_ray(way), active & ~is_exit)
        if dr.hint(subsurface is not None, mode="scalar"):
            exit_si, factor = subsurface.walk(scene, si, way, random_bits(lobe, direction), is_exit)
            next_si = dr.select(is_exit, exit_si, next_si)
            throughput *= dr.select(is_exit, factor, 1.0)
            active &= dr.any(throughput != 0.0)
        # Add the light of an emitter that the path hits, weighted against next event estimation.
        hit = mi.DirectionSample3f(scene, next_si, si)
        delta = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Delta)
        square = light_sampler.squared_density(si, hit, probabilities, active & ~delta)
        mis_weight = power_heuristic(bsdf_sample.pdf, dr.select(delta, 0.0, square))
        direction, share = hit.d, mi.Float(1.0)
        if dr.hint(tracer.caustic_sun is not None, mode="scalar"):
            in_caustic = active & after_matt & delta & ~next_si.is_valid()
            direction, share = tracer.caustic_sun.widened(hit.d, in_caustic)
            after_matt |= ~delta | is_exit
            next_si.wi = dr.select(in_caustic, -direction, next_si.wi)
        light = throughput * mis_weight * share * hit.emitter.eval(next_si, active)
        radiance = groups.add(radiance, dr.select(active, light, 0.0), hit.emitter, direction)
        vertex += 1
        length += dr.select(is_exit, 0, 1)
        survival = dr.select(
            vertex < ALL_SAMPLED_VERTICES, 1.0, dr.minimum(1.0, SURVIVAL_FACTOR * dr.max(throughput))
        )
        active &= sampler.vertex_1d(vertex, EMITTER_CHOICE, 1) < survival
        throughput /= survival
        active &= next_si.is_valid() & (length + 1 < tracer.max_depth)
        si = next_si
    return radiance


@dr.syntax
def _all_direct_light(
    tracer: PathTracer,
    sampler: OwenSampler,
    vertex: Any,
    si: Any,
    bsdf: Any,
    throughput: Any,
    radiance: Any,
    active: Any,
) -> Any:
    """Add the reflected light of a sampled position on every emitter."""
    light_sampler = tracer.light_sampler
    count, number = light_sampler.near_count, mi.UInt32(0)
    if dr.hint(count > 0, mode="scalar"):
        while dr.hint(
            active & (number < count),
            label="emitters",
            exclude=[tracer, sampler, light_sampler, vertex, si, bsdf, throughput, active, count],
        ):
            position = sampler.vertex_2d(vertex, EMITTER_POSITION, 1 + number)
            sample = light_sampler.sample_each(number, si, position, active)
            light = throughput * _direct_light(tracer, si, bsdf, sample, active)
            radiance = tracer.groups.add(radiance, light, sample.emitter, sample.direction)
            number += 1
    for index in range(count, len(light_sampler)):
        position = sampler.vertex_2d(vertex, EMITTER_POSITION, 1 + index)
        wanted = active & (light_sampler.expected_samples(vertex, active)[index] > 0.0)
        sample = light_sampler.sample_distant(index, vertex, si, position, wanted)
        light = throughput * _direct_light(tracer, si, bsdf, sample, wanted)
        radiance = tracer.groups.add(radiance, light, sample.emitter, sample.direction)
    return radiance


def camera_vertex(tracer: Any, sampler: OwenSampler, corner: Any, size: Any) -> tuple[Any, Any]:
    """Return the first surface interaction of a path, and its throughput.

    tracer  has a scene, Mitsuba's integrator and `hide_emitters`
    """
    sensor = tracer.scene.sensors()[0]
    lens = sampler.sample_2d(LENS) if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    ray, weight = sensor.sample_ray(0.0, 0.0, (corner + sampler.sample_2d(PIXEL)) / size, lens)
    pi = tracer.scene.ray_intersect_preliminary(ray, coherent=True)
    si = pi.compute_surface_interaction(ray)
    if tracer.hide_emitters:
        on_emitter = si.is_valid() & (si.shape.emitter() != None)  # noqa: E711 an array of pointers
        past = tracer.integrator.skip_area_emitters(tracer.scene, si.spawn_ray(ray.d), True, on_emitter)
        behind = past.compute_surface_interaction(ray, mi.RayFlags.All, on_emitter)
        behind.t = dr.norm(behind.p - ray.o)
        si = dr.select(on_emitter, behind, si)
    return si, mi.Color3f(weight)


def _direct_light(tracer: PathTracer, si: Any, bsdf: Any, sample: LightSample, active: Any) -> Any:
    """Return the light of a sampled position on an emitter that a BSDF reflects, 0 where it is occluded."""
    active = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    reflected, bsdf_pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(sample.direction), active)
    others = sample.square - dr.square(sample.density) + dr.square(bsdf_pdf)
    weight = dr.select(sample.is_delta, 1.0, power_heuristic(sample.density, others))
    light = sample.light * reflected * weight
    active &= dr.any(light != 0.0)
    active &= ~tracer.scene.ray_test(si.spawn_ray_to(sample.target), active)
    return dr.select(active, light, 0.0)


def power_heuristic(pdf: Any, others: Any) -> Any:
    """Return the weight of a sample that several strategies could have found (Veach 1997).

    pdf     its density
    others  sum of the squared densities of the other strategies
    """
    square = pdf * pdf
    weight = square / (square + others)
    return dr.select(dr.isfinite(weight), weight, 0.0)
