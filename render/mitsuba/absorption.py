"""Absorption inside clear bodies (Beer 1852, Lambert 1760).

In compiled variants a texture of ours computes it: where light reaches the surface from inside, it is
multiplied by exp(−rate · distance), exactly and without noise. The scalar variant, in which such a texture is
slow, uses Mitsuba's medium, which samples free paths.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from render.scene.materials import Glass

_NAME = "flowsculpt_absorbing"

RATE = "absorption_rate"
"""Name of the texture's rate among the parameters of a scene."""


def textures(glass: Glass, size: float) -> dict[str, Any]:
    """Return what an absorbing dielectric transmits and reflects. size: half the subject's, scene units"""
    if glass.absorption is None or not _is_compiled():
        return {}
    import mitsuba as mi

    _register()
    rate = mi.ScalarColor3f([part / size for part in glass.absorption.rate])
    absorbing = {"type": _NAME, "rate": rate}
    return {
        "specular_transmittance": {**absorbing, "tint": mi.ScalarColor3f(glass.colour)},
        "specular_reflectance": {**absorbing, "tint": mi.ScalarColor3f(1.0)},
    }


def medium(glass: Glass, size: float) -> dict[str, Any] | None:
    """Return the medium inside the surface for the scalar variant, or None."""
    if glass.absorption is None or _is_compiled():
        return None
    strongest = max(*glass.absorption.rate, 1e-9)
    relative = {"type": "rgb", "value": [part / strongest for part in glass.absorption.rate]}
    return {"type": "homogeneous", "albedo": 0.0, "sigma_t": relative, "scale": strongest / size}


def integrator(glass: Glass) -> str:
    """Return the integrator that can trace paths through the glass."""
    return "volpathmis" if glass.absorption is not None and not _is_compiled() else "path"


def _is_compiled() -> bool:
    import mitsuba as mi

    return mi.variant() != "scalar_rgb"


@cache
def _register() -> None:
    """Register the texture with Mitsuba, whose classes exist once a variant is chosen."""
    import drjit as dr
    import mitsuba as mi

    class Absorbing(mi.Texture):
        """Return the tint for light from outside, and times the absorption for light from inside."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.rate = mi.Color3f(properties["rate"])
            self.tint = mi.Color3f(properties["tint"])

        def traverse(self, callback: Any) -> None:
            callback.put(RATE, self.rate, mi.ParamFlags.Differentiable)

        def eval(self, si: Any, active: Any = True) -> Any:
            inside = mi.Frame3f.cos_theta(si.wi) < 0.0
            return self.tint * dr.select(inside, dr.exp(-self.rate * si.t), 1.0)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"Absorbing[rate={self.rate}, tint={self.tint}]"

    mi.register_texture(_NAME, Absorbing)
