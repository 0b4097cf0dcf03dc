"""Brushed metal: an anisotropic conductor whose tangents follow the scratches.

Mitsuba's tangents are constant on each triangle. In compiled variants a BSDF of ours turns them to the vertex
attribute SCRATCH_TANGENT, which triangles interpolate, so that highlights show no triangles. The scalar
variant, in which such a BSDF is slow, uses Mitsuba's tangents. Functions need a started engine.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.mitsuba.texture_coordinates import SCRATCH_TANGENT
from render.scene.materials import BrushedMetal

_NAME = "flowsculpt_brushed"

_ALONG_SCRATCHES = 0.3
"""Roughness along the scratches, over the roughness across."""

_SCRATCH_CONTRAST = 0.3
"""Fraction of the colour that the deepest scratch does not reflect."""


def bsdf(material: BrushedMetal, roughness: float) -> dict[str, Any]:
    """Return the BSDF of one side. roughness: across the scratches"""
    import mitsuba as mi

    scratches = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(_scratches(material)[None])),
        "raw": True,
        "filter_type": "bilinear",
    }
    metal = {
        "type": "roughconductor",
        "material": "none",
        "specular_reflectance": scratches,
        "alpha_u": roughness,
        "alpha_v": roughness * _ALONG_SCRATCHES,
        "distribution": "ggx",
    }
    if mi.variant() == "scalar_rgb":
        return metal
    _register()
    return {"type": _NAME, "metal": metal}


def _scratches(material: BrushedMetal) -> NDArray[np.float32]:
    """Return reflectances (N, 3) along one scene unit across the scratches, fine and coarse ones."""
    random, count = np.random.default_rng(11), 1024
    depth = np.zeros(count)
    for width, strength in ((1, 0.5), (4, 0.3), (16, 0.2)):
        depth += strength * np.repeat(random.random(count // width), width)
    return np.asarray(
        (1.0 - _SCRATCH_CONTRAST * depth)[:, None] * np.array(material.colour), dtype=np.float32
    )


@cache
def _register() -> None:
    """Register the BSDF with Mitsuba, whose classes exist once a variant is chosen."""
    import drjit as dr
    import mitsuba as mi

    class Brushed(mi.BSDF):
        """Evaluate the nested metal with its second tangent along the scratches."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.metal = properties["metal"]
            self.m_components = [self.metal.flags(index) for index in range(self.metal.component_count())]
            self.m_flags = self.metal.flags()

        def traverse(self, callback: Any) -> None:
            callback.put("metal", self.metal, mi.ParamFlags.Differentiable)

        def sample(
            self, context: Any, si: Any, lobe: Any, direction: Any, active: Any = True
        ) -> tuple[Any, Any]:
            turned, turn = self._turned(si, active)
            sampled, weight = self.metal.sample(context, turned, lobe, direction, active)
            sampled.wo = turn.to_world(sampled.wo)
            return sampled, weight

        def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            turned, turn = self._turned(si, active)
            return self.metal.eval(context, turned, turn.to_local(wo), active)

        def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            turned, turn = self._turned(si, active)
            return self.metal.pdf(context, turned, turn.to_local(wo), active)

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            turned, turn = self._turned(si, active)
            return self.metal.eval_pdf(context, turned, turn.to_local(wo), active)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            return self.metal.eval_diffuse_reflectance(si, active)

        def to_string(self) -> str:
            return f"Brushed[{self.metal}]"

        def _turned(self, si: Any, active: Any) -> tuple[Any, Any]:
            """Return the interaction with `wi` in the frame of the scratches, and that frame in `si`'s."""
            along = si.to_local(
                mi.Vector3f(si.shape.eval_attribute_3(f"vertex_{SCRATCH_TANGENT}", si, active))
            )
            length = dr.norm(mi.Vector2f(along.x, along.y))
            is_clear = length > 1e-6
            x, y = dr.select(is_clear, along.x / length, 0.0), dr.select(is_clear, along.y / length, 1.0)
            turn = mi.Frame3f(mi.Vector3f(y, -x, 0.0), mi.Vector3f(x, y, 0.0), mi.Vector3f(0.0, 0.0, 1.0))
            turned = mi.SurfaceInteraction3f(si)
            turned.wi = turn.to_local(si.wi)
            return turned, turn

    mi.register_bsdf(_NAME, Brushed)
