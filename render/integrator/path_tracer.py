"""The path tracer: means of the samples of each pixel, in code that Dr.Jit compiles.

It computes the same light as Mitsuba's `path` with less noise. Paths lead from the lens, by way of surfaces,
to emitters: path tracing with next event estimation and multiple importance sampling (Veach 1997). Random
numbers continue one sequence from batch to batch (`flowsculpt.render.integrator.sampler`), and emitters are
chosen by their irradiance (`flowsculpt.render.integrator.light_sampler`). Until a path has left two matt
surfaces all emitters are sampled, later one at each vertex. Some paths that leave a matt surface are guided
to caustics (`flowsculpt.render.integrator.caustic_guide`), or leave these to photons
(`flowsculpt.render.integrator.caustic_picture`). Faint paths end by Russian roulette. The samples of a pixel
are taken one after the other, so that sums have a fixed order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned, aligned_columns
from flowsculpt.render.integrator.caustic_guide import GuidedBsdf
from flowsculpt.render.integrator.cut_outs import CutOuts, UnseenLights
from flowsculpt.render.integrator.light_sampler import LightSample, LightSampler
from flowsculpt.render.integrator.sampler import (
    DIRECTION,
    EMITTER_CHOICE,
    EMITTER_POSITION,
    LENS,
    LOBE,
    PIXEL,
    OwenSampler,
)
from flowsculpt.render.integrator.scene_emitters import EmitterGroups
from flowsculpt.render.integrator.subsurface_paths import SubsurfaceWalk, SubsurfaceWalks, random_bits

MAX_SAMPLED_TOGETHER, ALL_SAMPLED_VERTICES = 6, 2
"""Most emitters that are all sampled at the first vertices of a path, and the number of matt surfaces among
these vertices. With more emitters, one is chosen there too."""

SURVIVAL_FACTOR = 4.0
"""Probability that a path goes on after its first vertices, over its throughput (Russian roulette)."""

SURE_VERTICES = 2
"""First vertices from which every path goes on."""


@dataclass(frozen=True, eq=False)
class ShadowCatcher:
    """A shape that is invisible itself, while shadows on it show.

    shape  pointer to it
    empty  path tracer of a scene with this shape and the emitters alone
    """

    shape: Any
    empty: PathTracer


@dataclass(frozen=True, eq=False)
class PathTracer:
    """A path tracer for one scene.

    max_depth      vertices of a path, the emitter's included
    unseen         lights that the lens does not see itself
    groups         light groups, each with its own sum; by default one of all emitters
    objects        shapes whose coverage of the pixel is measured
    catcher        a shape that is invisible itself, while shadows on it show; or None
    subsurface     random walks below the surfaces of subjects, or None
    caustic_sun    a `photons.CausticSun`, or None
    guide          directions of caustics at matt surfaces: a `caustic_guide.CausticGuide`, or None
    caustics       light that paths leave to photons: a `caustic_picture.CausticPicture`, or None
    occluders      a scene of all that can hide emitters; None is `surfaces`
    cut_outs       a `cut_outs.CutOuts` of the scene, or None where no surface has holes
    air            an `air_light.Air` that scatters light, or None
    """

    scene: Any
    light_sampler: LightSampler
    max_depth: int
    unseen: UnseenLights
    groups: EmitterGroups = field(default_factory=EmitterGroups)
    objects: Sequence[Any] = ()
    catcher: ShadowCatcher | None = None
    subsurface: SubsurfaceWalk | SubsurfaceWalks | None = None
    caustic_sun: Any = None
    guide: Any = None
    caustics: Any = None
    occluders: Any = None
    cut_outs: Any = None
    air: Any = None

    @property
    def surfaces(self) -> Any:
        """The scene or cut-out search that rays are intersected with."""
        return self.scene if self.cut_outs is None else self.cut_outs

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
        number, corner, size, shape = film_pixels(self.scene, pixels)
        sums = _sum_samples(self, OwenSampler(number, first, samples, seed), corner, size)
        dr.eval(sums)
        picture = np.empty((dr.width(number), len(sums)))
        for channel, values in enumerate(sums):
            picture[:, channel] = np.array(values)
        picture /= samples
        if self.caustics is not None:
            self._add_caustics(picture, pixels)
        del sums
        dr.flush_malloc_cache()
        return picture.reshape(*shape, -1)

    def _add_caustics(self, picture: NDArray[np.float64], pixels: NDArray[np.integer[Any]] | None) -> None:
        """Add the light of photons to means (pixels, channels) over paths, as if each path had found it."""
        radiance = self.caustics.radiance
        groups = radiance.reshape(-1, radiance.shape[-1])
        groups = groups if pixels is None else groups[pixels]
        light = groups.reshape(len(groups), -1, 3).sum(axis=1)
        luminance = np.array(mi.luminance(mi.Color3f(*aligned_columns(light))), dtype=np.float64)
        picture[:, :3] += light
        picture[:, 4] += luminance * (2.0 * picture[:, 3] + luminance)
        picture[:, 3] += luminance
        if self.groups.are_wanted:
            picture[:, 5 : 5 + groups.shape[1]] += groups


def film_pixels(scene: Any, pixels: NDArray[np.integer[Any]] | None) -> tuple[Any, Any, Any, tuple[int, ...]]:
    """Return numbers of pixels in the whole picture, their upper left corners in the rendered part, its size,
    and the shape of results: (H, W) or, with `pixels`, (pixels,).

    scene   Mitsuba's
    pixels  as of `PathTracer.render`
    """
    film = scene.sensors()[0].film()
    (width, height), (left, top) = film.crop_size(), film.crop_offset()
    shape = (int(height), int(width)) if pixels is None else pixels.shape
    numbers = np.arange(int(width) * int(height)) if pixels is None else pixels
    index = mi.UInt32(aligned(numbers, np.uint32))
    row = index // dr.opaque(mi.UInt32, int(width))
    column = index - row * int(width)
    number = (row + int(top)) * int(film.size()[0]) + column + int(left)
    return number, mi.Point2f(column, row), mi.Point2f(mi.ScalarPoint2f(film.crop_size())), shape


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
        if dr.hint(tracer.air is not None, mode="scalar"):
            scattered, throughput = _air_light(tracer, sampler, si, throughput, corner, size)
        parts, caught = _beside_catcher(tracer, sampler, si, throughput)
        if dr.hint(tracer.air is not None, mode="scalar"):
            parts = _plus(parts, scattered)
        coverage = _plus(coverage, [*_seen(tracer, si), *caught])
        light = sum(parts[1:], parts[0])
        groups = _plus(groups, parts)
        y = mi.luminance(light)
        radiance += light
        luminance += y
        square += y * y
        sample += 1
    return [*radiance, luminance, square, *(channel for group in groups for channel in group), *coverage]


def _air_light(
    tracer: PathTracer, sampler: OwenSampler, si: Any, throughput: Any, corner: Any, size: Any
) -> tuple[list[Any], Any]:
    """Return the light, by group, that air before the first surfaces of paths scatters towards the lens, and
    the throughput behind it."""
    ray, _ = lens_ray(tracer, sampler, corner, size)
    chance = sampler.vertex_1d(mi.UInt32(0), EMITTER_CHOICE, 3)
    point = tracer.air.scatters(ray, dr.select(si.is_valid(), si.t, dr.inf), chance)
    first = mi.UInt32(0)
    at = PathVertex(first, first, point.si, point, throughput * point.share, mi.Bool(False))
    light = _all_direct_light(tracer, sampler, at, tracer.groups.zeros(), point.si.is_valid())
    return _finite(light), throughput * point.clear


def _finite(parts: list[Any]) -> list[Any]:
    """Return parts, black where not finite. `dr.minimum` and `clip` pass NaN on: its sources are mended."""
    is_finite = dr.isfinite(mi.luminance(sum(parts[1:], parts[0])))
    return [dr.select(is_finite, part, 0.0) for part in parts]


def _plus(totals: list[Any], parts: list[Any]) -> list[Any]:
    return [total + part for total, part in zip(totals, parts, strict=False)]


def _seen(tracer: PathTracer, si: Any) -> list[Any]:
    """Return 1 or 0 for alpha and each object, by what the lens sees. A visible sky is opaque."""
    hit = si.is_valid() if tracer.unseen.sky else mi.Bool(True)
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


def lens_ray(tracer: Any, sampler: OwenSampler, corner: Any, size: Any) -> tuple[Any, Any]:
    """Return the ray that leaves the lens for a path, and its weight."""
    sensor = tracer.scene.sensors()[0]
    lens = sampler.sample_2d(LENS) if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    ray, weight = sensor.sample_ray(0.0, 0.0, (corner + sampler.sample_2d(PIXEL)) / size, lens)
    return ray, weight


def camera_vertex(tracer: Any, sampler: OwenSampler, corner: Any, size: Any) -> tuple[Any, Any]:
    """Return the first surface interaction of a path, and its throughput.

    tracer  has a scene, `cut_outs` and `unseen` lights
    """
    ray, weight = lens_ray(tracer, sampler, corner, size)
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
        bsdf = _bsdf(tracer, si, is_exit, active)
        is_matt = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        by_photons &= ~is_matt
        at = PathVertex(vertex, matt, si, bsdf, throughput, by_photons)
        radiance, counts = _sampled_light(tracer, sampler, at, radiance, active)
        if dr.hint(tracer.caustics is not None, mode="scalar"):
            radiance, has_photons = _photon_light(tracer, sampler, at, radiance, active & is_matt)
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
        if dr.hint(tracer.caustics is not None, mode="scalar"):
            by_photons |= has_photons & ~is_delta
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


def _photon_light(
    tracer: PathTracer, sampler: OwenSampler, at: PathVertex, radiance: Any, active: Any
) -> tuple[list[Any], Any]:
    """Add the caustics on matt surfaces behind the first to the radiance by light group. Return it, and where
    photons bring all of them: there, and where the lens sees the surface."""
    behind, is_first = tracer.caustics.behind, at.vertex == 0
    wanted = active & ~is_first & behind.reaches(at.si.p)
    beside = sampler.vertex_2d(at.vertex, EMITTER_POSITION, MAX_SAMPLED_TOGETHER + 1)
    parts = behind.reflected(at.si, at.bsdf, beside, wanted)
    sums = [total + at.throughput * part for total, part in zip(radiance, parts, strict=True)]
    return sums, wanted | (active & is_first)


def power_heuristic(pdf: Any, others: Any) -> Any:
    """Return the weight of a sample that several strategies could have found (Veach 1997).

    pdf     its density
    others  sum of the squared densities of the other strategies
    """
    square = pdf * pdf
    weight = square / (square + others)
    return dr.select(dr.isfinite(weight), weight, 0.0)
