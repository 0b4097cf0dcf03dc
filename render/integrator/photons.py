"""Photons: light that reaches matt surfaces from emitters by way of mirrors and glass alone.

Light of a small sun that glass or a mirror throws on a matt surface is found only by paths that leave the
surface in just the right direction: once in a hundred thousand, and then it is a firefly. Seen from such a
path the sun is a wider disc of the same light (`CausticSun`), which blurs the caustic by as much. Kaplanyan
and Dachsbacher (*Path Space Regularization for Holistic and Robust Light Transport*, 2013) widen the
reflection instead; for a distant light this is the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import components
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.integrator.light_sampler import LightSampler, LightSource

SEED = 1990
"""Seed of the photons' random numbers, the same for all frames."""

SAMPLES_PER_PHOTON, LEAST_PHOTONS, MOST_PHOTONS = 8, 1 << 12, 1 << 19
"""Camera paths for each photon, which costs half as much as one; and least and most photons of a scene. A
power of two keeps the compiled code the same."""


Landed = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]
"""Places, directions and weights of photons, as of `Photons`."""

_NONE: Landed = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0)


@dataclass(frozen=True, eq=False)
class Photons:
    """Photons where they meet the first matt surface.

    places      (P, 3) scene units
    directions  (P, 3) unit vectors to where they come from
    weights     (P,) light of each
    middle      (3,) of the sphere around all mirrors and glass
    radius      of that sphere, scene units
    irradiance  by the emitters, of a disc in that sphere that faces each
    """

    places: NDArray[np.float32]
    directions: NDArray[np.float32]
    weights: NDArray[np.float64]
    middle: NDArray[np.float64]
    radius: float
    irradiance: float

    @classmethod
    def of(cls, sphere: tuple[Any, Any], landed: Sequence[Landed], light: float) -> Photons:
        """Return photons that landed, in parts. sphere: of `caster_sphere`; light: that enters it"""
        middle, radius = np.array(sphere[0], dtype=np.float64).ravel(), float(sphere[1][0])
        places, directions, weights = (np.concatenate(part) for part in zip(_NONE, *landed, strict=True))
        return cls(places, directions, weights, middle, radius, light / (np.pi * radius**2))

    def within(self, distance: float) -> Photons:
        """Return the photons within a distance of the middle, in scene units."""
        kept = np.linalg.norm(self.places - self.middle, axis=1) < distance
        places, directions, weights = self.places[kept], self.directions[kept], self.weights[kept]
        return replace(self, places=places, directions=directions, weights=weights)


def photon_count(samples: int) -> int:
    """Return how many photons guide the camera paths of a scene, 0 for too few to need them.

    samples  of all pixels together
    """
    wanted = samples // SAMPLES_PER_PHOTON
    return 0 if wanted < LEAST_PHOTONS else min(1 << (wanted.bit_length() - 1), MOST_PHOTONS)


def casters(scene: Any) -> list[Any]:
    """Return the shapes of a scene that throw caustics: they reflect or refract, and nothing diffusely."""
    return [shape for shape in scene.shapes() if not shape.is_emitter() and _is_caster(shape)]


def _is_caster(shape: Any) -> bool:
    flags = shape.bsdf().flags()
    has_smooth = mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Glossy)
    is_point = dr.norm(shape.bbox().extents()) == 0.0  # a collapsed body, which no sphere surrounds
    return bool(has_smooth) and not is_point and not mi.has_flag(flags, mi.BSDFFlags.Diffuse)


def caster_sphere(scene: Any) -> tuple[Any, Any]:
    """Return middle and radius of the sphere around all mirrors and glass, data of the compiled code."""
    box: Any = mi.ScalarBoundingBox3f()
    for shape in casters(scene):
        box.expand(shape.bbox())
    sphere = mi.Point3f(box.center()), mi.Float(0.5 * dr.norm(box.extents()))
    dr.make_opaque(*sphere)
    return sphere


def trace_photons(
    scene: Any, light_sampler: LightSampler, sun: CausticSun | None, depth: int, count: int
) -> Photons | None:
    """Trace about `count` photons through a scene; return None without mirrors, glass or photons.

    sun    of daylight, or None
    depth  most vertices of a path, the emitter's included
    """
    sources = [source for source in light_sampler.sources if not source.is_rest]
    if not casters(scene) or not sources or not count:
        return None
    sphere = caster_sphere(scene)
    each = count // len(sources)
    parts: list[Landed] = []
    light = 0.0
    for number, source in enumerate(sources):
        random = mi.PCG32(  # type: ignore[operator]  # Mitsuba's stubs say object
            each, dr.opaque(mi.UInt64, SEED + number)
        )
        ray, weight = _emit(source, sun, *sphere, random)
        dr.eval(ray, weight)
        light += float(np.array(weight).sum(dtype=np.float64)) / each
        limits = dr.opaque(mi.UInt32, depth), dr.opaque(mi.UInt32, int(mi.BSDFFlags.All))
        _, ray, colour = followed(scene, ray, mi.Color3f(weight / each), random, *limits)
        parts.append(_landed(scene, ray, colour))
    return Photons.of(sphere, parts, light)


def _emit(
    source: LightSource, sun: CausticSun | None, middle: Any, radius: Any, random: Any
) -> tuple[Any, Any]:
    """Return rays from a light source towards a sphere, and the light of each."""
    u, v = (
        mi.Point2f(random.next_float32(), random.next_float32()),
        mi.Point2f(random.next_float32(), random.next_float32()),
    )
    if source.position is not None:
        ray, light = area_rays(source.emitter, middle, radius, u, v)
        return ray, mi.luminance(light)
    if source.distribution is None:
        towards, light = -source.facing, source.strength
    else:
        towards, density = source.distribution.sample(u)
        sky = dr.zeros(mi.SurfaceInteraction3f, dr.width(u))
        sky.wi = -towards
        light = mi.luminance(source.emitter.eval(sky)) / density
        light = dr.select(density > 0.0, light, 0.0)
        towards = towards if sun is None else sun.spread(towards)
    ray, area = disc_rays(towards, middle, radius, v)
    return ray, mi.Float(light * area)


def disc_rays(towards: Any, middle: Any, radius: Any, position: Any) -> tuple[Any, Any]:
    """Return rays of distant light on a sphere, and the area that they are spread over.

    towards   unit vectors to the light
    position  two numbers from 0 to 1 for each
    """
    disc = mi.warp.square_to_uniform_disk_concentric(position) * radius
    frame = mi.Frame3f(-towards)
    origin = middle + frame.s * disc.x + frame.t * disc.y + towards * (100.0 * radius)
    return mi.Ray3f(origin, -towards), np.pi * radius * radius


def area_rays(emitter: Any, middle: Any, radius: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """Return rays from places on softboxes into the cones around a sphere, and the light (RGB) of each.

    emitter  array of pointers to them
    u, v     two numbers from 0 to 1 for each: of the place, and of the direction in the cone
    """
    place, area = emitter.sample_position(0.0, u)
    offset = middle - place.p
    distance = dr.norm(offset)
    sine = radius / distance
    height = dr.select(sine < 1.0, 1.0 - dr.safe_sqrt(1.0 - sine * sine), 2.0)
    direction = mi.Frame3f(offset / distance).to_world(mi.warp.square_to_uniform_cone(v, 1.0 - height))
    cosine = dr.maximum(dr.dot(direction, place.n), 0.0)
    ray = mi.Ray3f(place.p + direction * (1e-4 * distance), direction)
    on_light = dr.zeros(mi.SurfaceInteraction3f, dr.width(u))
    on_light.wi = mi.Vector3f(0.0, 0.0, 1.0)
    return ray, mi.Color3f(emitter.eval(on_light) * (area * cosine * (2.0 * dr.pi * height)))


@dr.syntax
def followed(scene: Any, ray: Any, weight: Any, random: Any, depth: Any, first: Any) -> tuple[Any, Any, Any]:
    """Return numbers, last rays and light of the photons that meet a matt surface after mirrors or glass.

    weight  light of each photon, RGB
    depth   most vertices of a path, the emitter's included
    first   Mitsuba's flags of what the first surface may do: another photon ends there

    Photons are the paths of `render.integrator.path_tracer` from their other end: each brings what BSDF and
    normals give the path (Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, 1997,
    chapter 5).
    """
    vertex, landed = mi.UInt32(0), mi.Bool(False)
    ray, weight = mi.Ray3f(ray), mi.Color3f(weight)
    active = dr.any(weight > 0.0)
    while dr.hint(active, label="photons", exclude=[scene, depth, first]):
        si = scene.ray_intersect(ray, active)
        active &= si.is_valid() & (si.shape.emitter() == None)  # noqa: E711 an array of pointers
        bsdf = si.bsdf()
        is_matt = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        landed |= is_matt & (vertex > 0)
        active &= ~is_matt
        lobe, u, v = random.next_float32(), random.next_float32(), random.next_float32()
        context = mi.BSDFContext(mi.TransportMode.Importance)
        sampled, factor = bsdf.sample(context, si, lobe, mi.Point2f(u, v), active)
        active &= (vertex > 0) | ((sampled.sampled_type & first) != 0)
        way = si.to_world(sampled.wo)
        slope = dr.abs(dr.dot(si.n, way) / dr.dot(si.n, ray.d))
        is_delta = mi.has_flag(sampled.sampled_type, mi.BSDFFlags.Delta)
        by_normals = dr.abs(mi.Frame3f.cos_theta(si.wi) / mi.Frame3f.cos_theta(sampled.wo))
        backwards = dr.copy(si)
        backwards.wi = sampled.wo
        is_smooth = active & ~is_delta & (sampled.pdf > 0.0)
        value = bsdf.eval(mi.BSDFContext(), backwards, si.wi, is_smooth)
        factor = slope * dr.select(is_delta, factor * by_normals, value / sampled.pdf)
        factor = dr.select(dr.isfinite(mi.luminance(factor)), factor, 0.0)
        weight = dr.select(active, weight * factor, weight)
        active &= dr.any(weight > 0.0) & (vertex + 2 < depth)
        ray = dr.select(active, si.spawn_ray(way), ray)
        vertex += 1
    dr.eval(ray, weight, landed)
    index: Any = dr.compress(landed)
    return index, dr.gather(mi.Ray3f, ray, index), dr.gather(mi.Color3f, weight, index)


def _landed(scene: Any, ray: Any, colour: Any) -> Landed:
    """Return where photons land, by their last rays and light."""
    if not dr.width(colour):
        return _NONE
    place = scene.ray_intersect(ray).p
    weights = np.array(mi.luminance(colour), dtype=np.float64)
    return components(place).T, -components(ray.d).T, weights


WIDTH = math.radians(6.0)
"""Angular diameter of the sun in caustics, radians."""

_RIM = 1.01
"""Distance from the middle of a disc, over its radius, that rounding never puts the rim beyond."""


@dataclass(frozen=True, eq=False)
class CausticSun:
    """The sun of a sky, for paths that left a matt surface and came through glass or by a mirror.

    direction  unit vector to the sun
    radius     of its disc, radians
    factor     width in caustics over that of the disc, at least 1
    """

    direction: Any
    radius: Any
    factor: Any

    @classmethod
    def of(cls, direction: Triple, width: float) -> CausticSun:
        """Return the sun in a direction; width: angular diameter of its disc, radians."""
        sun = cls(mi.Vector3f(direction), mi.Float(width / 2.0), mi.Float(max(1.0, WIDTH / width)))
        dr.make_opaque(sun.direction, sun.radius, sun.factor)
        return sun

    def widened(self, direction: Any, active: Any) -> tuple[Any, Any]:
        """Return where a path that leaves the scene looks, and the factor on the light from there.

        direction  unit vector along the path
        active     True for paths that are part of a caustic

        In the wider disc this is the place on the disc, at the same fraction of its radius. The sky behind,
        a ten-thousandth of the sun's light, is left out.
        """
        offset = direction - self.direction
        in_disc = active & (dr.norm(offset) < _RIM * self.factor * self.radius)
        on_disc = dr.normalize(self.direction + offset / self.factor)
        return dr.select(in_disc, on_disc, direction), dr.select(in_disc, dr.rcp(dr.square(self.factor)), 1.0)

    def is_on(self, direction: Any) -> Any:
        """Tell whether a direction leads to the disc."""
        return dr.norm(direction - self.direction) < _RIM * self.radius

    def spread(self, direction: Any) -> Any:
        """Return directions in the wider disc, for unit vectors to the disc; others stay."""
        offset = direction - self.direction
        in_disc = dr.norm(offset) < _RIM * self.radius
        return dr.select(in_disc, dr.normalize(self.direction + offset * self.factor), direction)
