"""Caustics that the lens sees on matt surfaces, as a picture: photons, each seen by the lens.

From a matt surface few directions lead by way of mirrors or glass to the sun or a softbox. From these all do,
so such light is found from that end: photons go from the emitter to the first matt surface, and from there to
the lens (light tracing by Arvo, *Backward ray tracing*, 1986; with importance, Veach 1997). Their picture is
added to that of the paths (`flowsculpt.render.integrator.path_tracer`), which leave out the same light.
Caustics that the lens sees in mirrors or through glass are in a map
(`flowsculpt.render.integrator.caustic_map`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned_columns, components
from flowsculpt.render.integrator.caustic_map import CausticMap
from flowsculpt.render.integrator.cut_outs import UnseenLights
from flowsculpt.render.integrator.light_sampler import Cone, LightSource, emitter_of
from flowsculpt.render.integrator.photons import (
    CausticSun,
    area_rays,
    caster_sphere,
    casters,
    disc_rays,
    followed,
)
from flowsculpt.render.integrator.scene_emitters import EmitterGroups

SAMPLES_PER_PHOTON = 2
"""Camera paths for each photon, which costs half as much as one."""

FIRST_PART = 8
"""Photons for each that is spread evenly. The others go where those lead to light that the lens sees."""

_TOGETHER = 1 << 19
"""Photons that are traced together, which bounds the memory."""

_MAPPED = 1 << 19
"""Most photons of each emission that are in the map."""

_SIDE, _LEAST_DENSITY = 32, 0.3
"""Rows and columns of the table of an emitter's photons, and its least density over the mean."""


def can_draw(scene: Any, sources: Sequence[LightSource]) -> bool:
    """Tell whether photons bring what paths would: from softboxes and the sun of daylight, where mirrors or
    glass are, but no rough glass.

    Rough glass gives back the light that it would lose, by the direction of the path
    (`flowsculpt.render.mitsuba.custom_plugins`).
    """
    bsdfs = [shape.bsdf() for shape in casters(scene)]
    is_rough = any(mi.has_flag(bsdf.flags(), mi.BSDFFlags.GlossyTransmission) for bsdf in bsdfs)
    sampled = [source for source in sources if not source.is_rest]
    are_known = all(
        source.position is not None or isinstance(source.distribution, Cone) for source in sampled
    )
    return bool(bsdfs) and bool(sampled) and are_known and not is_rough


@dataclass(frozen=True, eq=False)
class CausticPicture:
    """Light that photons bring, and paths leave out.

    radiance   (H, W, 3 · groups) by light group, where the lens sees caustics itself
    behind     those that it sees by way of other surfaces
    softboxes  pointers to the emitters of photons
    sun        whose photons are in the picture too, or None. Otherwise it has the light of all emitters that
               next event estimation samples
    """

    radiance: NDArray[np.float64]
    behind: CausticMap
    softboxes: Sequence[Any]
    sun: CausticSun | None

    def has(self, emitter: Any, direction: Any) -> Any:
        """Tell whether photons bring the light of an emitter.

        emitter    array of pointers
        direction  unit vectors to it
        """
        found = mi.Bool(False) if self.sun is None else self.sun.is_on(direction)
        for softbox in self.softboxes:
            found |= emitter == softbox
        return found


def caustic_picture(
    scene: Any,
    sources: Sequence[LightSource],
    sun: CausticSun | None,
    groups: EmitterGroups,
    depth: int,
    samples: int,
    seed: int,
    unseen: UnseenLights | None = None,
) -> CausticPicture:
    """Trace photons, and return their light.

    scene       with mirrors or glass, and sources, that `can_draw`
    sources     of the light sampler
    sun         of daylight, or None
    depth       most vertices of a path, the emitter's included
    samples     of all pixels together, by which photons are counted
    unseen      lights in the picture that the lens does not see, or None without any
    """
    boxes = [source for source in sources if source.position is not None]
    suns = [source for source in sources if isinstance(source.distribution, Cone)]
    emissions: list[_Emission] = [_Softboxes(scene, boxes)] if boxes else []
    if sun is not None:
        emissions += [_Sunlight(scene, suns[0], sun, kind) for kind in _kinds(scene)]
    width, height = (int(side) for side in scene.sensors()[0].film().crop_size())
    total = max(FIRST_PART, samples // SAMPLES_PER_PHOTON)
    sums = np.zeros((3 * groups.count, width * height))
    tracer = _PhotonTracer(scene, groups, depth, unseen, sums, min(total, _MAPPED))
    for number, emission in enumerate(emissions):
        tracer.trace_all(emission, total, np.random.default_rng((seed, number)))
    radiance = np.ascontiguousarray(sums.T).reshape(height, width, -1) * (width * height / total)
    return CausticPicture(radiance, tracer.map(), [source.emitter for source in boxes], sun)


def _kinds(scene: Any) -> list[Any]:
    """Return the flags of what the first surface of sunlight may do."""
    flags = [shape.bsdf().flags() for shape in casters(scene)]
    kinds = mi.BSDFFlags.Delta, mi.BSDFFlags.GlossyReflection
    return [kind for kind in kinds if any(mi.has_flag(each, kind) for each in flags)]


def _parts(first: int, end: int) -> list[tuple[int, int]]:
    """Return the numbers of photons that are traced together, launch by launch: the first and the end."""
    return [(begun, min(begun + _TOGETHER, end)) for begun in range(first, end, _TOGETHER)]


def _focused(
    count: int, parts: Sequence[tuple[NDArray[np.float32], NDArray[np.float64]]]
) -> NDArray[np.float32]:
    """Return the density of places on `count` emitters, by results of `_PhotonTracer.trace` with an even
    one."""
    places, luminance = (np.concatenate(each, axis=-1) for each in zip(*parts, strict=True))
    sides = np.array([[_SIDE * count], [_SIDE]])
    column, row = np.minimum(places * sides, sides - 1).astype(np.int64)
    square = np.bincount(row * sides[0, 0] + column, luminance**2, _SIDE * _SIDE * count)
    density = np.sqrt(square).reshape(_SIDE, -1)
    density += _LEAST_DENSITY * density.mean() + 1e-30
    return np.asarray(density / density.mean(), dtype=np.float32)


class _Emission:
    """Photons of some emitters. Two numbers from 0 to 1, the place, give each an emitter and its aim.

    count  emitters, side by side in the first number
    first  Mitsuba's flags of what the first surface may do: another photon ends there
    """

    count: int
    first: Any

    def photons(self, place: Any, numbers: Any) -> tuple[Any, Any, Any, Any]:
        """Return rays, their light, and pointers to the emitters and directions to them for `EmitterGroups`.

        numbers  random ones
        """
        raise NotImplementedError


class _Sunlight(_Emission):
    """Photons of the sun. Smooth surfaces reflect a wider one, as they do for paths."""

    count = 1

    def __init__(self, scene: Any, source: LightSource, sun: CausticSun, first: Any) -> None:
        self._sphere, self._source, self._sun, self.first = caster_sphere(scene), source, sun, first

    def photons(self, place: Any, numbers: Any) -> tuple[Any, Any, Any, Any]:
        source, u = self._source, mi.Point2f(numbers.next_float32(), numbers.next_float32())
        towards, density = source.distribution.sample(u)
        sky = dr.zeros(mi.SurfaceInteraction3f, dr.width(towards))
        sky.wi = -towards
        light = source.emitter.eval(sky) * (source.distribution.correction / density)
        if self.first == mi.BSDFFlags.Delta:
            towards = self._sun.spread(towards)
        ray, area = disc_rays(towards, *self._sphere, place)
        return ray, light * area, source.emitter, self._sun.direction


class _Softboxes(_Emission):
    """Photons of softboxes, each into the cone around all mirrors and glass."""

    first = mi.BSDFFlags.All

    def __init__(self, scene: Any, sources: Sequence[LightSource]) -> None:
        self._sphere, self._sources, self.count = caster_sphere(scene), sources, len(sources)

    def photons(self, place: Any, numbers: Any) -> tuple[Any, Any, Any, Any]:
        across = place.x * self.count
        number = dr.minimum(mi.UInt32(across), self.count - 1)
        emitter = emitter_of(self._sources, number)
        aim = mi.Point2f(across - number, place.y)
        on_box = mi.Point2f(numbers.next_float32(), numbers.next_float32())
        ray, light = area_rays(emitter, *self._sphere, on_box, aim)
        return ray, light * self.count, emitter, -ray.d


@dataclass(eq=False)
class _PhotonTracer:
    """Traces photons to the lens. Fields are those of `caustic_picture`.

    sums  (3 · groups, pixels) light that the lens sees of all photons
    kept  photons of each emission that are in the map, with the light of all
    """

    scene: Any
    groups: EmitterGroups
    depth: int
    unseen: UnseenLights | None
    sums: NDArray[np.float64]
    kept: int
    _landed: list[tuple[NDArray[Any], ...]] = field(default_factory=list)

    def trace_all(self, emission: _Emission, total: int, random: np.random.Generator) -> None:
        """Trace photons of an emission: a few that are spread evenly, and others where those lead to light
        that the lens sees."""
        first = total // FIRST_PART
        table = _focused(
            emission.count, [self.trace(emission, *part, None, random) for part in _parts(0, first)]
        )
        for part in _parts(first, total):
            self.trace(emission, *part, table, random)

    def trace(
        self, emission: _Emission, first: int, end: int, table: Any, random: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Add the light of some photons of an emission to the sums.

        Returns the places (2, P) of photons that land, and the luminance of each that the lens sees.

        first, end  numbers of the photons in the emission
        table       density of places, or None for an even one
        """
        numbers: Any = mi.PCG32(  # type: ignore[operator]  # Mitsuba's stubs say object
            end - first, dr.opaque(mi.UInt64, int(random.integers(1 << 63)))
        )
        place, share = _places(numbers, table)
        ray, light, emitter, towards = emission.photons(place, numbers)
        light *= share
        dr.schedule(place, emitter)  # with the photons: each piece of compiled code takes milliseconds
        limits = dr.opaque(mi.UInt32, self.depth), dr.opaque(mi.UInt32, int(emission.first))
        index, last, weight = followed(self.scene, ray, light, numbers, *limits)
        if not dr.width(index):
            return np.zeros((2, 0), np.float32), np.zeros(0)
        si = self.scene.ray_intersect(last)
        pixel, light = self._seen(si, last, weight, random)
        if self.groups.count > 1 and dr.width(emitter) > 1:
            emitter = dr.gather(mi.EmitterPtr, emitter, index)
        parts = self.groups.add(self.groups.zeros(), light, emitter, towards)
        luminance, place = mi.luminance(light), dr.gather(mi.Point2f, place, index)
        landed = si.p, last.d, self.groups.add(self.groups.zeros(), weight, emitter, towards)
        dr.eval(pixel, parts, luminance, place, landed)
        self._keep(int(np.searchsorted(np.array(index), self.kept - first)), *landed)
        pixels = np.array(pixel)
        for total, channel in zip(self.sums, (channel for part in parts for channel in part), strict=True):
            values = np.broadcast_to(np.array(channel, dtype=np.float64), pixels.shape)
            total += np.bincount(pixels, values, len(total))
        return components(place), np.array(luminance, dtype=np.float64)

    def map(self) -> CausticMap:
        """Return the map of the photons that were kept."""
        channels = 3 * self.groups.count
        none = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, channels))
        parts = (np.concatenate(part) for part in zip(none, *self._landed, strict=True))
        return CausticMap.of(caster_sphere(self.scene), *parts)

    def _keep(self, count: int, place: Any, direction: Any, light: Sequence[Any]) -> None:
        """Keep the first photons of those that land."""
        if count:
            channels = [channel for group in light for channel in group]
            columns = [np.broadcast_to(np.array(each, np.float64), dr.width(place)) for each in channels]
            places, directions = (components(each)[:, :count].T for each in (place, direction))
            self._landed.append((places, -directions, np.stack(columns, axis=1)[:count] / self.kept))

    def _seen(self, si: Any, ray: Any, weight: Any, random: np.random.Generator) -> tuple[Any, Any]:
        """Return the pixels that see where photons land, and the light that reaches the lens from there.

        ray     the last of each photon
        weight  light of each
        """
        sensor = self.scene.sensors()[0]
        on_lens = mi.Point2f(*aligned_columns(random.random((2, dr.width(weight)), dtype=np.float32).T))
        seen, importance = sensor.sample_direction(si, on_lens, si.is_valid())
        active = si.is_valid() & dr.any(importance > 0.0)
        backwards = dr.copy(si)
        backwards.wi = si.to_local(seen.d)
        value = si.bsdf().eval(mi.BSDFContext(), backwards, si.wi, active)
        slope = dr.abs(dr.dot(si.n, seen.d) / dr.dot(si.n, ray.d))
        light = weight * value * importance * slope
        active &= dr.any(light > 0.0) & dr.isfinite(mi.luminance(light))
        active &= ~self._is_hidden(si, seen.p, active)
        width, height = (dr.opaque(mi.UInt32, int(side)) for side in sensor.film().crop_size())
        column, row = (
            dr.minimum(mi.UInt32(part), side - 1) for part, side in zip(seen.uv, (width, height), strict=True)
        )
        return dr.select(active, row * width + column, 0), dr.select(active, light, 0.0)

    def _is_hidden(self, si: Any, lens: Any, active: Any) -> Any:
        """Tell whether anything that the lens sees stands between it and where photons land."""
        ray = si.spawn_ray_to(lens)
        if self.unseen is None:
            return self.scene.ray_test(ray, active)
        nearest = self.unseen.nearest(self.scene, ray, active)
        return nearest.is_valid() & (dr.norm(nearest.p - si.p) < dr.norm(lens - si.p))


def _places(numbers: Any, table: Any) -> tuple[Any, Any]:
    """Return places in the unit square, and the factor on the light there, by random numbers."""
    place = mi.Point2f(numbers.next_float32(), numbers.next_float32())
    if table is None:
        return place, mi.Float(1.0)
    warp: Any = mi.Hierarchical2D0(table, [], normalize=True)
    place, density = warp.sample(place)
    return place, dr.rcp(density)
