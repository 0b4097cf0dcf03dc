"""Caustics of the sun that the lens sees on matt surfaces, as a picture: photons, each seen by the lens.

From a matt surface few directions lead by way of mirrors or glass to the sun. From the sun all do, so such
light is found from that end: photons go from the sun to the first matt surface, and from there to the lens
(light tracing by Arvo, *Backward ray tracing*, 1986; with importance, Veach 1997). Their picture is added to
that of the paths, which leave out the same light (`render.integrator.path`). Caustics seen in mirrors or
through glass are left to the paths.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.integrator.caustic_sun import CausticSun
from render.integrator.emitter_groups import EmitterGroups
from render.integrator.light_sampler import LightSource
from render.integrator.photons import caster_sphere, casters, disc_rays, followed

SAMPLES_PER_PHOTON = 4
"""Camera paths for each photon, which costs half as much as one."""

FIRST_PART = 8
"""Photons for each that is spread evenly. The others go where those lead to light that the lens sees."""

_TOGETHER = 1 << 19
"""Photons that are traced together, which bounds the memory."""

_SIDE, _LEAST_DENSITY = 32, 0.3
"""Rows and columns of the table of places on the sphere's disc, and its least density over the mean."""


def can_draw(scene: Any) -> bool:
    """Tell whether photons bring what paths would: where mirrors or glass are, but no rough glass.

    Rough glass gives back the light that it would lose, by the direction of the path
    (`render.mitsuba.absorption`).
    """
    bsdfs = [shape.bsdf() for shape in casters(scene)]
    return bool(bsdfs) and not any(
        mi.has_flag(bsdf.flags(), mi.BSDFFlags.GlossyTransmission) for bsdf in bsdfs
    )


def caustic_picture(
    scene: Any,
    source: LightSource,
    sun: CausticSun,
    groups: EmitterGroups,
    depth: int,
    samples: int,
    seed: int,
) -> NDArray[np.float64]:
    """Return the radiance (H, W, 3 · groups) of caustics of the sun, by light group.

    scene    with mirrors or glass that `can_draw`
    source   the sun in the light sampler
    depth    most vertices of a path, the emitter's included
    samples  of all pixels together, by which photons are counted
    """
    flags = [shape.bsdf().flags() for shape in casters(scene)]
    kinds = [
        kind
        for kind in (mi.BSDFFlags.Delta, mi.BSDFFlags.GlossyReflection)
        if any(mi.has_flag(each, kind) for each in flags)
    ]
    width, height = (int(side) for side in scene.sensors()[0].film().crop_size())
    sums = np.zeros((3 * groups.count, width * height))
    total = max(FIRST_PART, samples // SAMPLES_PER_PHOTON)
    light_of = _PhotonLight(scene, source, sun, groups, depth)
    for kind in kinds:
        random = np.random.default_rng((seed, int(kind)))
        first = total // FIRST_PART
        table = _focused([light_of.trace(kind, n, None, random, sums) for n in _parts(first)])
        for count in _parts(total - first):
            light_of.trace(kind, count, table, random, sums)
    return np.ascontiguousarray(sums.T).reshape(height, width, -1) * (width * height / total)


def _parts(count: int) -> list[int]:
    """Return how many of `count` photons are traced together, launch by launch."""
    return [min(_TOGETHER, count - begun) for begun in range(0, count, _TOGETHER)]


def _focused(parts: Sequence[tuple[NDArray[np.float32], NDArray[np.float64]]]) -> NDArray[np.float32]:
    """Return the density of places by results of `_PhotonLight.trace` with an even one."""
    places, luminance = (np.concatenate(each, axis=-1) for each in zip(*parts, strict=True))
    column, row = np.minimum(places * _SIDE, _SIDE - 1).astype(np.int64)
    square = np.bincount(row * _SIDE + column, luminance**2, _SIDE * _SIDE)
    density = np.sqrt(square).reshape(_SIDE, _SIDE)
    density += _LEAST_DENSITY * density.mean() + 1e-30
    return np.asarray(density / density.mean(), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class _PhotonLight:
    """Photons of the sun, and what the lens sees of them. Fields are those of `caustic_picture`."""

    scene: Any
    source: LightSource
    sun: CausticSun
    groups: EmitterGroups
    depth: int

    def trace(
        self, kind: Any, count: int, table: Any, random: np.random.Generator, sums: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Add the light of `count` photons to sums (3 · groups, pixels).

        Returns the places (2, P) on the disc, in the unit square, of photons that land, and the luminance of
        each that the lens sees.

        kind   of the first surface: the sun that smooth ones reflect is wider, as it is for paths
        table  density of places, or None for an even one
        """
        numbers: Any = mi.PCG32(  # type: ignore[operator]  # Mitsuba's stubs say object
            count, dr.opaque(mi.UInt64, int(random.integers(1 << 63)))
        )
        place, share = _places(numbers, table)
        towards, light = self._emitted(numbers)
        if kind == mi.BSDFFlags.Delta:
            towards = self.sun.spread(towards)
        ray, area = disc_rays(towards, *caster_sphere(self.scene), place)
        limits = dr.opaque(mi.UInt32, self.depth), dr.opaque(mi.UInt32, int(kind))
        dr.eval(ray, light, numbers, place)
        index, ray, weight = followed(self.scene, ray, light * area * share, numbers, *limits)
        if not dr.width(index):
            return np.zeros((2, 0), np.float32), np.zeros(0)
        pixel, light = self._seen(ray, weight, random)
        parts = self.groups.add(self.groups.zeros(), light, self.source.emitter, self.sun.direction)
        luminance, place = mi.luminance(light), dr.gather(mi.Point2f, place, index)
        dr.eval(pixel, parts, luminance, place)
        pixels = np.array(pixel)
        for total, channel in zip(sums, (channel for part in parts for channel in part), strict=True):
            values = np.broadcast_to(np.array(channel, dtype=np.float64), pixels.shape)
            total += np.bincount(pixels, values, len(total))
        return np.array(place), np.array(luminance, dtype=np.float64)

    def _emitted(self, numbers: Any) -> tuple[Any, Any]:
        """Return directions to the sun's disc, and the irradiance of each."""
        towards, density = self.source.distribution.sample(
            mi.Point2f(numbers.next_float32(), numbers.next_float32())
        )
        sky = dr.zeros(mi.SurfaceInteraction3f, dr.width(towards))
        sky.wi = -towards
        light = self.source.emitter.eval(sky) * (self.source.distribution.correction / density)
        return towards, light

    def _seen(self, ray: Any, weight: Any, random: np.random.Generator) -> tuple[Any, Any]:
        """Return the pixels that see where photons land, and the light that reaches the lens from there.

        ray     the last of each photon
        weight  light of each
        """
        si, sensor = self.scene.ray_intersect(ray), self.scene.sensors()[0]
        on_lens = mi.Point2f(random.random((2, dr.width(weight)), dtype=np.float32))
        seen, importance = sensor.sample_direction(si, on_lens, si.is_valid())
        active = si.is_valid() & dr.any(importance > 0.0)
        backwards = dr.copy(si)
        backwards.wi = si.to_local(seen.d)
        value = si.bsdf().eval(mi.BSDFContext(), backwards, si.wi, active)
        slope = dr.abs(dr.dot(si.n, seen.d) / dr.dot(si.n, ray.d))
        light = weight * value * importance * slope
        active &= dr.any(light > 0.0) & dr.isfinite(mi.luminance(light))
        active &= ~self.scene.ray_test(si.spawn_ray_to(seen.p), active)
        width, height = (dr.opaque(mi.UInt32, int(side)) for side in sensor.film().crop_size())
        column, row = (
            dr.minimum(mi.UInt32(part), side - 1) for part, side in zip(seen.uv, (width, height), strict=True)
        )
        return dr.select(active, row * width + column, 0), dr.select(active, light, 0.0)


def _places(numbers: Any, table: Any) -> tuple[Any, Any]:
    """Return places in the unit square, and the factor on the light there, by random numbers."""
    place = mi.Point2f(numbers.next_float32(), numbers.next_float32())
    if table is None:
        return place, mi.Float(1.0)
    warp: Any = mi.Hierarchical2D0(table, [], normalize=True)
    place, density = warp.sample(place)
    return place, dr.rcp(density)
