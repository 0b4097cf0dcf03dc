"""Paths of light, in code that Dr.Jit compiles: from the lens, by way of surfaces, to emitters.

Path tracing with next event estimation and multiple importance sampling (Veach 1997). Until a path has left
two matt surfaces all emitters are sampled, later one at each vertex. Some paths that leave a matt surface are
guided to caustics (`flowsculpt.render.integrator.caustic_guide`), or leave these to photons
(`flowsculpt.render.integrator.caustic_picture`). Faint paths end by Russian roulette.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import mitsuba as mi

from flowsculpt.render.integrator.caustic_guide import GuidedBsdf
from flowsculpt.render.integrator.cut_outs import CutOuts
from flowsculpt.render.integrator.light_sampler import LightSample
from flowsculpt.render.integrator.sampler import (
    DIRECTION,
    EMITTER_CHOICE,
    EMITTER_POSITION,
    LENS,
    LOBE,
    PIXEL,
    OwenSampler,
)
from flowsculpt.render.integrator.subsurface_paths import random_bits

if TYPE_CHECKING:
    from flowsculpt.render.integrator.path_tracer import PathTracer

MAX_SAMPLED_TOGETHER, ALL_SAMPLED_VERTICES = 6, 2
"""Most emitters that are all sampled at the first vertices of a path, and the number of matt surfaces among
these vertices. With more emitters, one is chosen there too."""

SURVIVAL_FACTOR = 4.0
"""Probability that a path goes on after its first vertices, over its throughput (Russian roulette)."""

SURE_VERTICES = 2
"""First vertices from which every path goes on."""


class PathVertex(NamedTuple):
    """A vertex of each path.

    vertex      its number, from 0
    matt        matt surfaces that the path has left before
    si          surface interaction
    throughput  of the path, before the vertex
    by_photons  True for paths whose caustics are taken from photons
    """

    vertex: Any
    matt: Any
    si: Any
    bsdf: Any
    throughput: Any
    by_photons: Any


def camera_vertex(tracer: Any, sampler: OwenSampler, corner: Any, size: Any) -> tuple[Any, Any]:
    """Return the first surface interaction of a path, and its throughput.

    tracer  has a scene, `cut_outs` and `unseen` lights
    """
    sensor = tracer.scene.sensors()[0]
    lens = sampler.sample_2d(LENS) if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    ray, weight = sensor.sample_ray(0.0, 0.0, (corner + sampler.sample_2d(PIXEL)) / size, lens)
    unseen = tracer.unseen
    if tracer.cut_outs is not None or unseen.softboxes:
        surfaces = tracer.cut_outs or CutOuts(tracer.scene, ())
        chance = sampler.vertex_1d(mi.UInt32(0), EMITTER_CHOICE, 2)
        return surfaces.ray_intersect(ray, True, chance, unseen), mi.Color3f(weight)
    pi = tracer.scene.ray_intersect_preliminary(ray, coherent=True)
    si = pi.compute_surface_interaction(ray)
    if unseen.softboxes is None:
        on_emitter = si.is_valid() & (si.shape.emitter() != None)  # noqa: E711 an array of pointers
        past = unseen.integrator.skip_area_emitters(tracer.scene, si.spawn_ray(ray.d), True, on_emitter)
        behind = past.compute_surface_interaction(ray, mi.RayFlags.All, on_emitter)
        behind.t = dr.norm(behind.p - ray.o)
        si = dr.select(on_emitter, behind, si)
    return si, mi.Color3f(weight)


@dr.syntax
def trace(tracer: PathTracer, sampler: OwenSampler, si: Any, throughput: Any) -> Any:
    """Trace one path through each pixel from its first surface interaction, and return its radiance by light
    group."""
    groups = tracer.groups
    radiance = groups.zeros()
    if dr.hint(not tracer.unseen.are_all, mode="scalar"):
        emitter = si.emitter(tracer.scene)
        light = throughput * emitter.eval(si)
        if dr.hint(tracer.unseen.sky, mode="scalar"):
            light = dr.select(si.is_valid(), light, 0.0)
        radiance = groups.add_seen(radiance, light, emitter, -si.wi, ~si.is_valid())
    vertex, matt, length, active = mi.UInt32(0), mi.UInt32(0), mi.UInt32(0), si.is_valid()
    kept = mi.Color3f(throughput)
    is_exit, after_matt, by_photons = mi.Bool(False), mi.Bool(False), mi.Bool(False)
    while dr.hint(active, label="path", exclude=[tracer, sampler, groups]):
        bsdf = _bsdf(tracer, si, is_exit, active & _is_guided(tracer, vertex, matt))
        is_matt = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        by_photons &= ~is_matt
        at = PathVertex(vertex, matt, si, bsdf, throughput, by_photons)
        radiance, counts = _sampled_light(tracer, sampler, at, radiance, active)
        bsdf_sample, weight, kept_weight, next_si, is_exit = _next_vertex(
            tracer, sampler, vertex, si, bsdf, active
        )
        throughput *= weight
        kept *= kept_weight
        active &= dr.any(throughput != 0.0)
        is_delta = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Delta)
        light, emitter, direction = _light_of_hit(
            tracer, si, next_si, bsdf_sample.pdf, is_delta, after_matt, by_photons, counts, active
        )
        radiance = groups.add(radiance, dr.select(active, throughput * light, 0.0), emitter, direction)
        after_matt |= ~is_delta | is_exit
        by_photons |= is_matt & ~is_delta & (vertex == 0)
        vertex += 1
        matt += dr.select(is_matt, 1, 0)
        length += dr.select(is_exit, 0, 1)
        survival = _survival(vertex, kept)
        active &= sampler.vertex_1d(vertex, EMITTER_CHOICE, 1) < survival
        throughput /= survival
        kept /= survival
        active &= next_si.is_valid() & (length + 1 < tracer.max_depth)
        si = next_si
    return radiance


def _is_guided(tracer: PathTracer, vertex: Any, matt: Any) -> Any:
    """Tell where the guide chooses directions: next to photons only at what mirrors and glass show."""
    return mi.Bool(True) if tracer.caustics is None else (vertex > 0) & (matt == 0)


def _bsdf(tracer: PathTracer, si: Any, is_exit: Any, active: Any) -> Any:
    """Return the BSDF at a vertex, with the guide to caustics."""
    if tracer.subsurface is not None:
        return tracer.subsurface.bsdf(si, is_exit)
    return si.bsdf() if tracer.guide is None else GuidedBsdf(tracer.guide, si, si.bsdf(), active)


def _next_vertex(
    tracer: PathTracer, sampler: OwenSampler, vertex: Any, si: Any, bsdf: Any, active: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Continue paths by their BSDF.

    Returns the sample of the BSDF, its weight, the weight for Russian roulette, the next surface interaction,
    and whether a random walk below the surface ends there. The weight for Russian roulette leaves out the
    guide, and the change of radiance in glass that light undoes as it leaves: paths with little of either are
    not faint.
    """
    lobe, direction = sampler.vertex_1d(vertex, LOBE), sampler.vertex_2d(vertex, DIRECTION)
    if isinstance(bsdf, GuidedBsdf):
        bsdf_sample, weight, unguided = bsdf.sample(mi.BSDFContext(), si, lobe, direction, active)
    else:
        bsdf_sample, weight = bsdf.sample(mi.BSDFContext(), si, lobe, direction, active)
        unguided = weight
    kept = unguided * dr.square(bsdf_sample.eta)
    active = active & dr.any(weight != 0.0)
    way = si.to_world(bsdf_sample.wo)
    if tracer.subsurface is None:
        next_si = tracer.surfaces.ray_intersect(si.spawn_ray(way), active)
        return bsdf_sample, weight, kept, next_si, mi.Bool(False)
    is_exit = tracer.subsurface.enters(si, bsdf_sample, active)
    next_si = tracer.surfaces.ray_intersect(si.spawn_ray(way), active & ~is_exit)
    seed = random_bits(lobe, direction)
    exit_si, factor = tracer.subsurface.walk(tracer.scene, si, way, seed, is_exit)
    factor = dr.select(is_exit, factor, 1.0)
    return bsdf_sample, weight * factor, kept * factor, dr.select(is_exit, exit_si, next_si), is_exit


def _light_of_hit(
    tracer: PathTracer,
    si: Any,
    next_si: Any,
    pdf: Any,
    is_delta: Any,
    after_matt: Any,
    by_photons: Any,
    counts: list[Any],
    active: Any,
) -> tuple[Any, Any, Any]:
    """Return the light of the emitters that paths hit, weighted against samples of these, the emitters and
    the directions to them.

    pdf         density of the direction from `si`, unless a mirror or glass gave it (is_delta)
    after_matt  True for paths that left a matt surface before
    by_photons  True for paths whose caustics are taken from photons
    counts      expected samples of each light source at `si`
    """
    hit = mi.DirectionSample3f(tracer.scene, next_si, si)
    square = tracer.light_sampler.squared_density(si, hit, counts, active & ~is_delta)
    weight = power_heuristic(pdf, dr.select(is_delta, 0.0, square))
    direction = hit.d
    if tracer.caustic_sun is not None:
        in_caustic = active & after_matt & is_delta & ~next_si.is_valid()
        direction, share = tracer.caustic_sun.widened(hit.d, in_caustic)
        weight *= share
        next_si = dr.copy(next_si)
        next_si.wi = dr.select(in_caustic, -direction, next_si.wi)
    if tracer.caustics is not None:
        weight = dr.select(by_photons & tracer.caustics.has(hit.emitter, direction), 0.0, weight)
    return weight * hit.emitter.eval(next_si, active), hit.emitter, direction


def _survival(vertex: Any, kept: Any) -> Any:
    """Return the probability with which paths go on from a vertex. kept: throughput for Russian roulette"""
    by_throughput = dr.minimum(1.0, SURVIVAL_FACTOR * dr.max(kept))
    return dr.select(vertex < SURE_VERTICES, 1.0, by_throughput)


def _sampled_light(
    tracer: PathTracer, sampler: OwenSampler, at: PathVertex, radiance: Any, active: Any
) -> tuple[Any, list[Any]]:
    """Add the reflected light of sampled emitters to the radiance by light group: of all at the first
    vertices, of one at later ones. Return it, and the expected samples of each light source."""
    light_sampler = tracer.light_sampler
    probabilities = light_sampler.probabilities(at.si)
    if len(light_sampler) == 0:
        return radiance, probabilities
    is_all_possible = len(light_sampler) <= MAX_SAMPLED_TOGETHER
    are_all_sampled = is_all_possible & (at.matt < ALL_SAMPLED_VERTICES)
    counts = probabilities
    wanted = active & mi.has_flag(at.bsdf.flags(), mi.BSDFFlags.Smooth)
    if tracer.caustics is not None and tracer.caustics.sun is None:
        wanted &= ~at.by_photons
    if is_all_possible:
        counts = light_sampler.expected_samples(at.matt, are_all_sampled, probabilities)
        radiance = _all_direct_light(tracer, sampler, at, radiance, wanted & are_all_sampled)
    later = wanted & ~are_all_sampled
    choice = sampler.vertex_1d(at.vertex, EMITTER_CHOICE)
    position = sampler.vertex_2d(at.vertex, EMITTER_POSITION)
    sample = light_sampler.sample_one(at.si, probabilities, choice, position, later)
    light = at.throughput * _direct_light(tracer, at, sample, later)
    return tracer.groups.add(radiance, light, sample.emitter, sample.direction), counts


@dr.syntax
def _all_direct_light(
    tracer: PathTracer, sampler: OwenSampler, at: PathVertex, radiance: Any, active: Any
) -> Any:
    """Add the reflected light of a sampled position on every emitter."""
    light_sampler = tracer.light_sampler
    count, number = light_sampler.near_count, mi.UInt32(0)
    if dr.hint(count > 0, mode="scalar"):
        while dr.hint(
            active & (number < count),
            label="emitters",
            exclude=[tracer, sampler, light_sampler, at, active, count],
        ):
            position = sampler.vertex_2d(at.vertex, EMITTER_POSITION, 1 + number)
            sample = light_sampler.sample_each(number, at.si, position, active)
            light = at.throughput * _direct_light(tracer, at, sample, active)
            radiance = tracer.groups.add(radiance, light, sample.emitter, sample.direction)
            number += 1
    for index in range(count, len(light_sampler)):
        position = sampler.vertex_2d(at.vertex, EMITTER_POSITION, 1 + index)
        wanted = active & (light_sampler.expected_samples(at.matt, active)[index] > 0.0)
        sample = light_sampler.sample_distant(index, at.matt, at.si, position, wanted)
        light = at.throughput * _direct_light(tracer, at, sample, wanted)
        radiance = tracer.groups.add(radiance, light, sample.emitter, sample.direction)
    return radiance


def _direct_light(tracer: PathTracer, at: PathVertex, sample: LightSample, active: Any) -> Any:
    """Return the light of a sampled position on an emitter that a BSDF reflects, 0 where it is occluded."""
    si = at.si
    active = mi.Bool(active)  # a copy: &= changes it in place
    if tracer.caustics is not None:
        active &= ~(at.by_photons & tracer.caustics.has(sample.emitter, sample.direction))
    reflected, bsdf_pdf = at.bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(sample.direction), active)
    others = sample.square - dr.square(sample.density) + dr.square(bsdf_pdf)
    weight = dr.select(sample.is_delta, 1.0, power_heuristic(sample.density, others))
    light = sample.light * reflected * weight
    active &= dr.any(light != 0.0)
    occluders = tracer.surfaces if tracer.occluders is None else tracer.occluders
    active &= ~occluders.ray_test(si.spawn_ray_to(sample.target), active)
    return dr.select(active, light, 0.0)


def power_heuristic(pdf: Any, others: Any) -> Any:
    """Return the weight of a sample that several strategies could have found (Veach 1997).

    pdf     its density
    others  sum of the squared densities of the other strategies
    """
    square = pdf * pdf
    weight = square / (square + others)
    return dr.select(dr.isfinite(weight), weight, 0.0)
