"""The surface over subsurface scattering: a BSDF that lets light in where the body would reflect it.

The path tracer takes a sample of DiffuseTransmission as the start of a random walk
(`render.integrator.subsurface_paths`). The scalar variant has no path tracer of ours, and the body reflects.
Functions need a started engine.
"""

from __future__ import annotations

from functools import cache
from typing import Any

_NAME = "flowsculpt_subsurface"

_COAT = 0.04
"""Reflectance of the coat along the normal (Schlick 1994), for the choice between coat and body."""


def bsdf(body: dict[str, Any], has_coat: bool) -> dict[str, Any]:
    """Return the BSDF of one side. body: the same surface without subsurface scattering"""
    import mitsuba as mi

    if mi.variant() == "scalar_rgb":
        return body
    _register()
    return {"type": _NAME, "body": body, "has_coat": has_coat}


@cache
def _register() -> None:
    """Register the BSDF with Mitsuba, whose classes exist once a variant is chosen."""
    import drjit as dr
    import mitsuba as mi

    glossy, diffuse = (
        mi.BSDFContext(mi.TransportMode.Radiance, int(flags))
        for flags in (mi.BSDFFlags.Glossy, mi.BSDFFlags.Diffuse)
    )

    class SubsurfaceBSDF(mi.BSDF):
        """Reflect by the coat of the nested body. Samples of its diffuse part go inwards."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.body, self.has_coat = properties["body"], properties["has_coat"]
            self.m_components = [self.body.flags(index) for index in range(self.body.component_count())]
            self.m_flags = self.body.flags()

        def traverse(self, callback: Any) -> None:
            callback.put("body", self.body, mi.ParamFlags.Differentiable)

        def sample(
            self, context: Any, si: Any, lobe: Any, direction: Any, active: Any = True
        ) -> tuple[Any, Any]:
            inside, weight = self.body.sample(diffuse, si, lobe, direction, active)
            inside.wo = -inside.wo
            inside.sampled_type = mi.UInt32(int(mi.BSDFFlags.DiffuseTransmission))
            if not self.has_coat:
                return inside, weight
            chance = self._coat_chance(si)
            is_coat = active & (lobe < chance)
            coat, coat_weight = self.body.sample(glossy, si, lobe, direction, is_coat)
            coat.pdf *= chance
            sampled = dr.select(is_coat, coat, inside)
            return sampled, dr.select(is_coat, coat_weight / chance, weight / (1.0 - chance))

        def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.body.eval(glossy, si, wo, active) if self.has_coat else mi.Color3f(0.0)

        def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            if not self.has_coat:
                return mi.Float(0.0)
            return self._coat_chance(si) * self.body.pdf(glossy, si, wo, active)

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            return self.body.eval_diffuse_reflectance(si, active)

        def to_string(self) -> str:
            return f"SubsurfaceBSDF[{self.body}]"

        def _coat_chance(self, si: Any) -> Any:
            """Return the probability with which the coat is sampled."""
            cosine = dr.clip(mi.Frame3f.cos_theta(si.wi), 0.0, 1.0)
            fresnel = _COAT + (1.0 - _COAT) * (1.0 - cosine) ** 5
            return dr.clip(fresnel / (fresnel + 0.5 * (1.0 - fresnel)), 0.1, 0.9)

    mi.register_bsdf(_NAME, SubsurfaceBSDF)
