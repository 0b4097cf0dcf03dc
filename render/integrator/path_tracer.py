"""Light followed along paths by compiled code, from the lens to the lamps.

A path tracer with next event estimation and multiple importance sampling (Veach 1997), as Mitsuba's `path`
is, and it finds the same light. What differs makes less noise: numbers come from one sequence that goes on
from pass to pass (`render.integrator.sampler`), lamps are looked for by the light they give, and from what
the lens sees all at once (`render.integrator.light_sampler`). The samples of a pixel are taken one after the
other, so that sums have an order.

Importing this imports Mitsuba, so an engine must have been started, of a variant that compiles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.integrator.light_sampler import Lamps
from render.integrator.sampler import CHOICE, LAMP, LENS, LOBE, ONWARDS, PIXEL, Draws

MOST_AT_ONCE = 6
"""Lamps that are all looked for from what the lens sees; of more, one is drawn there too."""


@dataclass(frozen=True, eq=False)
class Light:
    """The light of a scene.

    integrator  Mitsuba's, which is asked for nothing but to look past lamps
    depth       vertices a path may have, the lamp's one of them
    hides       whether the lens sees neither lamps nor what shines from all around
    """

    scene: Any
    integrator: Any
    lamps: Lamps
    depth: int
    hides: bool

    def picture(self, samples: int, first: int, seed: int) -> NDArray[np.float64]:
        """(H, W, 5): radiance, luminance and its square, means over samples.

        first  samples of the same picture and seed that were taken before
        """
        film = self.scene.sensors()[0].film()
        (width, height), (left, top) = film.crop_size(), film.crop_offset()
        here = dr.arange(mi.UInt32, int(width) * int(height))
        row = here // dr.opaque(mi.UInt32, int(width))
        column = here - row * int(width)
        whole = (row + int(top)) * int(film.size()[0]) + column + int(left)
        draws = Draws(whole, first, samples, seed)
        corner, size = mi.Point2f(column, row), mi.Point2f(mi.ScalarPoint2f(film.crop_size()))
        sums = _sums(self, draws, corner, size)
        dr.eval(sums)
        picture = np.stack([np.array(each, dtype=np.float64) for each in sums], axis=1) / samples
        dr.flush_malloc_cache()
        return picture.reshape(int(height), int(width), 5)


@dr.syntax
def _sums(light: Light, draws: Draws, corner: Any, size: Any) -> Any:
    """Five of (pixels,): of radiance, luminance and its square over all samples."""
    sample = mi.UInt32(0)
    radiance, luminance, square = mi.Color3f(0.0), mi.Float(0.0), mi.Float(0.0)
    while dr.hint(sample < draws.count, label="samples", exclude=[light, draws]):
        draws.sample = sample
        found = _followed(light, draws, corner, size)
        y = mi.luminance(found)
        radiance += found
        luminance += y
        square += y * y
        sample += 1
    return radiance.x, radiance.y, radiance.z, luminance, square


@dr.syntax
def _followed(light: Light, draws: Draws, corner: Any, size: Any) -> Any:
    """The radiance that one sample of each pixel finds."""
    scene, lamps, context = light.scene, light.lamps, mi.BSDFContext()
    si, factor = _first(light, draws, corner, size)
    found = mi.Color3f(0.0)
    if dr.hint(not light.hides, mode="scalar"):
        found += factor * si.emitter(scene).eval(si)
    vertex, active = mi.UInt32(0), si.is_valid()
    at_once = 0 < len(lamps) <= MOST_AT_ONCE
    if dr.hint(at_once, mode="scalar"):
        for number, emitter in enumerate(lamps.emitters):
            found += factor * _direct(light, si, emitter, draws.two(vertex, LAMP, 1 + number), active)
    while dr.hint(active, max_iterations=light.depth, label="path", exclude=[light, draws]):
        shares = lamps.shares(si)
        if dr.hint(at_once, mode="scalar"):
            shares = [dr.select(vertex == 0, 1.0, share) for share in shares]
        if dr.hint(len(lamps) > 0, mode="scalar"):
            emitter, share = lamps.drawn(shares, draws.one(vertex, CHOICE))
            wanted = active & (vertex > 0) if at_once else active
            found += factor / share * _direct(light, si, emitter, draws.two(vertex, LAMP), wanted, share)
        lobe, way = draws.one(vertex, LOBE), draws.two(vertex, ONWARDS)
        onwards, weight = si.bsdf().sample(context, si, lobe, way, active)
        factor *= weight
        active &= dr.any(factor != 0.0)
        seen = scene.ray_intersect(si.spawn_ray(si.to_world(onwards.wo)), active)
        hit = mi.DirectionSample3f(scene, seen, si)
        delta = mi.has_flag(onwards.sampled_type, mi.BSDFFlags.Delta)
        looked = lamps.share_of(hit.emitter, shares)
        looked *= hit.emitter.pdf_direction(si, hit, active & ~delta & (looked > 0.0))
        trust = _trust(onwards.pdf, dr.select(delta, 0.0, looked))
        found[active] += factor * trust * hit.emitter.eval(seen, active)
        vertex += 1
        active &= seen.is_valid() & (vertex + 1 < light.depth)
        si = seen
    return found


def _first(light: Light, draws: Draws, corner: Any, size: Any) -> tuple[Any, Any]:
    """What the lens sees in a sample of each pixel, and how much of it."""
    sensor = light.scene.sensors()[0]
    lens = draws.of_sample(LENS) if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    ray, factor = sensor.sample_ray(0.0, 0.0, (corner + draws.of_sample(PIXEL)) / size, lens)
    pi = light.scene.ray_intersect_preliminary(ray, coherent=True)
    si = pi.compute_surface_interaction(ray)
    if light.hides:
        on_lamp = si.is_valid() & (si.shape.emitter() != None)  # noqa: E711 an array of pointers
        past = light.integrator.skip_area_emitters(light.scene, si.spawn_ray(ray.d), True, on_lamp)
        behind = past.compute_surface_interaction(ray, mi.RayFlags.All, on_lamp)
        si = dr.select(on_lamp, behind, si)
    return si, mi.Color3f(factor)


def _direct(light: Light, si: Any, emitter: Any, place: Any, active: Any, share: Any = 1.0) -> Any:
    """What light comes straight from a place on a lamp, if nothing stands between."""
    bsdf = si.bsdf()
    active = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    there, light_there = emitter.sample_direction(si, place, active)
    reflected, density = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(there.d), active)
    light_there *= reflected * dr.select(there.delta, 1.0, _trust(there.pdf * share, density))
    active &= (there.pdf != 0.0) & dr.any(light_there != 0.0)
    active &= ~light.scene.ray_test(si.spawn_ray_to(there.p), active)
    return dr.select(active, light_there, 0.0)


def _trust(mine: Any, other: Any) -> Any:
    """How much what one of two ways found counts, by the densities of both: Veach's power heuristic."""
    square = mine * mine
    weight = square / dr.fma(other, other, square)
    return dr.select(dr.isfinite(weight), weight, 0.0)
