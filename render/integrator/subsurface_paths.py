"""Subsurface scattering: random walks of light below the subject's surface.

Light enters an opaque material, is scattered by a homogeneous medium, and leaves somewhere else, evenly into
all directions (Chiang, Kutz and Burley, *Practical and controllable subsurface scattering for production path
tracing*, 2016). The albedo of the medium is chosen such that a thick flat body reflects the colour of the
material, by a fit of theirs. In glass the same medium scatters light, without losses, between two passages
through the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

MAX_EVENTS = 1024
"""Scattering events after which a walk ends: one of fifty of a white body, none of a grey one."""

SURE_EVENTS = 16
"""Events after which Russian roulette may end a walk."""


class SubsurfaceWalk:
    """Random walks inside one shape.

    shape     pointer to it
    rate      scattering events per scene unit, of red, green and blue light
    is_glass  True if light enters and leaves by refraction
    """

    def __init__(self, shape: Any, rate: Any, is_glass: bool) -> None:
        self.shape, self.is_glass = shape, is_glass
        self.rate = mi.Color3f(*rate)
        dr.make_opaque(self.rate)
        white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
        self._white = mi.load_dict({"type": "twosided", "material": white})

    def bsdf(self, si: Any, is_exit: Any) -> Any:
        """Return the BSDF at a surface interaction: a white diffuse one where light leaves."""
        return si.bsdf() if self.is_glass else dr.select(is_exit, mi.BSDFPtr(self._white), si.bsdf())

    def enters(self, si: Any, sampled: Any, active: Any) -> Any:
        """Tell where a sample of the BSDF goes into the shape."""
        inwards = sampled.wo.z < 0.0
        if not self.is_glass:
            inwards = mi.has_flag(sampled.sampled_type, mi.BSDFFlags.DiffuseTransmission)
        return active & inwards & (si.shape == self.shape)

    def walk(self, scene: Any, si: Any, direction: Any, seed: Any, active: Any) -> tuple[Any, Any]:
        """Return the surface interaction where light leaves, and a factor of the throughput.

        si         where it enters
        direction  into the shape, world space
        seed       of random numbers, 32 bits

        In glass the interaction is the next one with the surface, and its distance is the length of the walk,
        by which the surface computes absorption. The factor is 0 where light does not leave.
        """
        albedo, scale = mi.Color3f(1.0), mi.Color3f(1.0)
        if not self.is_glass:
            colour = dr.clip(si.bsdf().eval_diffuse_reflectance(si, active), 1e-3, 1.0)
            albedo, scale = single_scattering_albedo(colour), dr.rcp(colour)
        ray = si.spawn_ray(direction)
        skipped = dr.norm(ray.o - si.p) / dr.maximum(dr.abs(dr.dot(direction, si.n)), 0.1)
        walked = _scatter(scene, ray, skipped, self.rate, albedo, seed, active)
        origin, direction, factor, length = walked
        exit_si = scene.ray_intersect(mi.Ray3f(origin, direction), active & dr.any(factor != 0.0))
        left = exit_si.is_valid() & (exit_si.shape == self.shape)
        if self.is_glass:
            exit_si.t += length
        else:
            outside = dr.select(dr.dot(direction, exit_si.n) > 0.0, 1.0, -1.0)
            exit_si.wi = mi.Vector3f(0.0, 0.0, outside)
        return exit_si, dr.select(left, factor * scale, 0.0)


class SubsurfaceWalks:
    """Random walks inside several shapes, with the methods of `SubsurfaceWalk`."""

    def __init__(self, walks: Sequence[SubsurfaceWalk]) -> None:
        self.walks = walks

    def bsdf(self, si: Any, is_exit: Any) -> Any:
        """Return the BSDF at a surface interaction: white and diffuse where light leaves an opaque one."""
        bsdf = si.bsdf()
        for walk in self.walks:
            bsdf = dr.select(si.shape == walk.shape, walk.bsdf(si, is_exit), bsdf)
        return bsdf

    def enters(self, si: Any, sampled: Any, active: Any) -> Any:
        """Tell where a sample of the BSDF goes into one of the shapes."""
        enters = mi.Bool(False)
        for walk in self.walks:
            enters |= walk.enters(si, sampled, active)
        return enters

    def walk(self, scene: Any, si: Any, direction: Any, seed: Any, active: Any) -> tuple[Any, Any]:
        """Return the surface interaction where light leaves, and a factor of the throughput."""
        exit_si, factor = dr.zeros(mi.SurfaceInteraction3f), mi.Color3f(0.0)
        for walk in self.walks:
            is_inside = active & (si.shape == walk.shape)
            left_si, left_factor = walk.walk(scene, si, direction, seed, is_inside)
            exit_si = dr.select(is_inside, left_si, exit_si)
            factor = dr.select(is_inside, left_factor, factor)
        return exit_si, factor


def single_scattering_albedo(colour: Any) -> Any:
    """Return the albedo of a medium whose thick flat body reflects the colour (Chiang et al. 2016)."""
    return 1.0 - dr.exp(colour * (-5.09406 + colour * (2.61188 - 4.31805 * colour)))


@dr.syntax
def _scatter(
    scene: Any, ray: Any, skipped: Any, rate: Any, albedo: Any, seed: Any, active: Any
) -> tuple[Any, Any, Any, Any]:
    """Return origin and direction of the last free path, the factor of the throughput, and the length of
    those before.

    skipped  length of the walk before the ray's origin

    Free paths are sampled for one of the three colours, chosen by the factor; the factor weighs all three
    (the balance heuristic).
    """
    factor: Any = mi.Color3f(1.0)
    origin, direction, length = ray.o, ray.d, mi.Float(0.0)
    event, active = mi.UInt32(0), mi.Bool(active)
    while dr.hint(active, max_iterations=MAX_EVENTS, label="subsurface", exclude=[scene]):
        place, survival = _random(seed, 3 * event)
        colour, _ = _random(seed, 3 * event + 1)
        share = factor / dr.maximum(dr.sum(factor), 1e-30)
        chosen = dr.select(colour < share.x, rate.x, dr.select(colour < share.x + share.y, rate.y, rate.z))
        distance = -dr.log(1.0 - place) / chosen
        before = dr.select(event == 0, skipped, 0.0)
        ray = mi.Ray3f(origin, direction)
        ray.maxt = dr.maximum(distance - before, 0.0)
        hit = scene.ray_intersect_preliminary(ray, active=active)
        left = hit.is_valid()
        distance = dr.select(left, hit.t + before, distance)
        transmitted = dr.exp(-rate * distance)
        density = dr.select(left, transmitted, rate * transmitted)
        factor *= dr.select(active, density * dr.select(left, 1.0, albedo) / dr.sum(share * density), 1.0)
        active &= ~left
        length += dr.select(active, distance, 0.0)
        origin = dr.select(active, ray(ray.maxt), origin)
        turned = mi.warp.square_to_uniform_sphere(mi.Point2f(*_random(seed, 3 * event + 2)))
        direction = dr.select(active, turned, direction)
        event += 1
        chance = dr.select(event < SURE_EVENTS, 1.0, dr.minimum(dr.max(factor), 1.0))
        dies = active & ((survival >= chance) | (event >= MAX_EVENTS))
        factor *= dr.select(active, dr.select(dies, 0.0, dr.rcp(chance)), 1.0)
        active &= ~dies
    return origin, direction, factor, length


def random_bits(lobe: Any, direction: Any) -> Any:
    """Return 32 bits that follow from the random numbers of a path's vertex."""
    numbers = (direction.x, direction.y, lobe)
    x, y, z = (mi.UInt32(number * 2.0**24) for number in numbers)
    bits: Any = mi.sample_tea_32(x ^ z * 0x9E3779B9, y)[0]  # type: ignore[call-overload]
    return bits


def _random(seed: Any, counter: Any) -> tuple[Any, Any]:
    """Return two random numbers from 0 to 1, excluding 1 (Zafar, Olano and Curtis 2010).

    With Mitsuba's 4 rounds numbers of successive counters are related, which moved colours by 6%.
    """
    first, second = mi.sample_tea_32(seed, counter, 8)
    return mi.Float(first >> 8) * 2.0**-24, mi.Float(second >> 8) * 2.0**-24
