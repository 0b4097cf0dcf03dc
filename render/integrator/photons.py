"""Photons: light that reaches matt surfaces from emitters by way of mirrors and glass alone.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.integrator.caustic_sun import CausticSun
from render.integrator.light_sampler import LightSampler, LightSource

SEED = 1990
"""Seed of the photons' random numbers, the same for all frames."""

SAMPLES_PER_PHOTON, LEAST_PHOTONS, MOST_PHOTONS = 8, 1 << 12, 1 << 19
"""Camera paths for each photon, which costs half as much as one; and least and most photons of a scene. A
power of two keeps the compiled code the same."""


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


def casts_caustics(bsdf: Any) -> bool:
    """Tell whether a material throws caustics: it reflects or refracts, and nothing diffusely."""
    flags = bsdf.flags()
    is_smooth = mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Glossy)
    return bool(is_smooth) and not mi.has_flag(flags, mi.BSDFFlags.Diffuse)


def trace_photons(
    scene: Any, light_sampler: LightSampler, sun: CausticSun | None, depth: int, count: int
) -> Photons | None:
    """Trace about `count` photons through a scene; return None without mirrors, glass or photons.

    sun    of daylight, or None
    depth  most vertices of a path, the emitter's included
    """
    casters = [shape for shape in scene.shapes() if not shape.is_emitter() and casts_caustics(shape.bsdf())]
    sources = [source for source in light_sampler.sources if not source.is_rest]
    if not casters or not sources or not count:
        return None
    box: Any = mi.ScalarBoundingBox3f()
    for shape in casters:
        box.expand(shape.bbox())
    middle, radius = np.array(box.center(), dtype=np.float64), 0.5 * float(dr.norm(box.extents()))
    sphere = mi.Point3f(middle), mi.Float(radius)
    dr.make_opaque(*sphere)
    each = count // len(sources)
    parts: list[Any] = []
    light = 0.0
    for number, source in enumerate(sources):
        random = mi.PCG32(each, SEED + number)  # type: ignore[operator]  # Mitsuba's stubs say object
        ray, weight = _emitted(source, sun, *sphere, random)
        dr.eval(ray, weight)
        light += float(np.array(weight).sum(dtype=np.float64)) / each
        parts.append(_landed(scene, ray, weight / each, random, dr.opaque(mi.UInt32, depth)))
    places, directions, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Photons(places, directions, weights, middle, radius, light / (np.pi * radius**2))


def _emitted(
    source: LightSource, sun: CausticSun | None, middle: Any, radius: Any, random: Any
) -> tuple[Any, Any]:
    """Return rays from a light source towards a sphere, and the light of each."""
    u, v = (
        mi.Point2f(random.next_float32(), random.next_float32()),
        mi.Point2f(random.next_float32(), random.next_float32()),
    )
    if source.position is not None:
        return _from_area(source, middle, radius, u, v)
    disc = mi.warp.square_to_uniform_disk_concentric(v) * radius
    area = np.pi * radius * radius
    if source.distribution is None:
        towards, light = -source.facing, source.strength
    else:
        towards, density = source.distribution.sample(u)
        sky = dr.zeros(mi.SurfaceInteraction3f, dr.width(u))
        sky.wi = -towards
        light = mi.luminance(source.emitter.eval(sky)) / density
        light = dr.select(density > 0.0, light, 0.0)
        towards = towards if sun is None else sun.spread(towards)
    frame = mi.Frame3f(-towards)
    origin = middle + frame.s * disc.x + frame.t * disc.y + towards * (100.0 * radius)
    return mi.Ray3f(origin, -towards), mi.Float(light * area)


def _from_area(source: LightSource, middle: Any, radius: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """Return rays from places on a softbox into the cone around a sphere, and the light of each."""
    place, _ = source.emitter.sample_position(0.0, u)
    offset = middle - place.p
    distance = dr.norm(offset)
    sine = dr.minimum(radius / distance, 1.0)
    height = 1.0 - dr.safe_sqrt(1.0 - sine * sine)
    direction = mi.Frame3f(offset / distance).to_world(mi.warp.square_to_uniform_cone(v, 1.0 - height))
    cosine = dr.maximum(dr.dot(direction, place.n), 0.0)
    ray = mi.Ray3f(place.p + direction * (1e-4 * distance), direction)
    return ray, mi.Float(source.strength * cosine * (2.0 * np.pi * height))


@dr.syntax
def _landed(
    scene: Any, ray: Any, weight: Any, random: Any, depth: Any
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]:
    """Return places, directions and weights of the photons that meet a matt surface after a mirror or glass.

    Photons that miss are left out.
    """
    vertex, landed = mi.UInt32(0), mi.Bool(False)
    ray, weight = mi.Ray3f(ray), mi.Float(weight)
    place, active = mi.Point3f(0.0), weight > 0.0
    while dr.hint(active, label="photons", exclude=[scene, depth]):
        si = scene.ray_intersect(ray, active)
        active &= si.is_valid() & (si.shape.emitter() == None)  # noqa: E711 an array of pointers
        bsdf = si.bsdf()
        is_matt = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        landed |= is_matt & (vertex > 0)
        place = dr.select(is_matt, si.p, place)
        active &= ~is_matt
        lobe, u, v = random.next_float32(), random.next_float32(), random.next_float32()
        sampled, factor = bsdf.sample(mi.BSDFContext(), si, lobe, mi.Point2f(u, v), active)
        weight = dr.select(active, weight * mi.luminance(factor), weight)
        active &= (weight > 0.0) & (vertex + 3 < depth)
        ray = dr.select(active, si.spawn_ray(si.to_world(sampled.wo)), ray)
        vertex += 1
    dr.eval(place, ray.d, weight, landed)
    places, directions, weights = (np.array(each) for each in (place, ray.d, weight))
    chosen = np.array(landed)
    return places.T[chosen], -directions.T[chosen], weights[chosen].astype(np.float64)
