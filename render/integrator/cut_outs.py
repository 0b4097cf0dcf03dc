"""Surfaces with holes, and lights that the lens does not see: what rays hit, in code that Dr.Jit compiles.

Where a fraction of a surface is there, so many rays hit it, all at 1 and none at 0 (Enderton et al.,
*Stochastic Transparency*, 2010). Rays from the lens take the same numbers for light, mattes and features, so
these agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi


@dataclass(frozen=True, eq=False)
class UnseenLights:
    """Lights that shine, and that the lens does not see itself.

    integrator  Mitsuba's, which looks past all softboxes
    sky         True if they include the sky
    softboxes   pointers to those in the picture; None for all that there are
    """

    integrator: Any
    sky: bool
    softboxes: Sequence[Any] | None

    @property
    def are_all(self) -> bool:
        """True if the lens sees no light itself."""
        return self.sky and self.softboxes is None

    def nearest(self, scene: Any, ray: Any, active: Any) -> Any:
        """Return the first surface interactions of rays to the lens, past the lights that it does not see."""
        if self.softboxes is None:
            found = self.integrator.skip_area_emitters(scene, ray, False, active)
            return found.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        return CutOuts(scene, ()).ray_intersect(ray, active, mi.Float(0.0), self)


@dataclass(frozen=True, eq=False)
class CutOuts:
    """The surfaces of a scene without their holes, with the methods of Mitsuba's scene for rays.

    scene      Mitsuba's
    fractions  pointers to shapes, and textures of the fractions that are there
    """

    scene: Any
    fractions: Sequence[tuple[Any, Any]]

    def ray_intersect(
        self, ray: Any, active: Any = True, chance: Any = None, unseen: UnseenLights | None = None
    ) -> Any:
        """Return the first surface interactions of rays.

        chance  numbers from 0 to 1, excluding 1, above the fraction where rays pass; None takes them from the
                bits of the rays
        unseen  lights that the rays pass through
        """
        chance = _bits_of(ray) if chance is None else chance
        return _first_hit(self, ray, mi.Bool(active), chance, unseen)

    def ray_test(self, ray: Any, active: Any = True) -> Any:
        """Return flags of the rays that hit a surface."""
        return self.ray_intersect(ray, active).is_valid()

    def fraction(self, si: Any, active: Any, unseen: UnseenLights | None) -> Any:
        """Return the fraction of surfaces that is there, 1 where rays hit none."""
        active, fraction = active & si.is_valid(), mi.Float(1.0)
        for shape, texture in self.fractions:
            here = active & (si.shape == shape)
            fraction = dr.select(here, dr.clip(texture.eval_1(si, here), 0.0, 1.0), fraction)
        if unseen is None:
            return fraction
        if unseen.softboxes is None:
            return dr.select(active & (si.shape.emitter() != None), 0.0, fraction)  # noqa: E711 of pointers
        for softbox in unseen.softboxes:
            fraction = dr.select(active & (si.shape == softbox), 0.0, fraction)
        return fraction


@dr.syntax
def _first_hit(cut_outs: CutOuts, ray: Any, active: Any, chance: Any, unseen: UnseenLights | None) -> Any:
    si = cut_outs.scene.ray_intersect(ray, active)
    fraction = cut_outs.fraction(si, active, unseen)
    passes = fraction <= chance
    while dr.hint(passes, label="cut-outs", exclude=[cut_outs, ray, unseen]):
        chance = (chance - fraction) / (1.0 - fraction)  # as even as before
        onward = si.spawn_ray(ray.d)
        onward.maxt = ray.maxt - dr.norm(si.p - ray.o)
        si = cut_outs.scene.ray_intersect(onward, passes)
        si.t = dr.select(si.is_valid(), dr.norm(si.p - ray.o), dr.inf)
        fraction = cut_outs.fraction(si, passes, unseen)
        passes = fraction <= chance
    return si


def _bits_of(ray: Any) -> Any:
    """Return a number from 0 to 1, excluding 1, that follows from the bits of a ray."""
    bits: Any = [dr.reinterpret_array(mi.UInt32, part) for part in (*ray.o, *ray.d)]
    x, y, *others = bits
    for number in others:
        x, y = mi.sample_tea_32(x ^ number, y)
    return mi.Float(x >> 8) * 2.0**-24
