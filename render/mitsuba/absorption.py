"""Absorption inside clear bodies (Beer 1852, Lambert 1760), and light that rough ones would lose.

In compiled variants a texture of ours computes both. Where light reaches the surface from inside, it is
multiplied by exp(−rate · distance), exactly and without noise; and by what makes up for the loss of a rough
surface (`render.mitsuba.rough_glass`). The scalar variant, in which such a texture is slow, uses Mitsuba's
medium, which samples free paths, and leaves the loss.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from render.mitsuba.rough_glass import COSINES, kept_light
from render.scene.materials import Glass

_NAME = "flowsculpt_absorbing"

RATE = "absorption_rate"
"""Name of the texture's rate among the parameters of a scene."""


def textures(glass: Glass, size: float) -> dict[str, Any]:
    """Return what a dielectric transmits and reflects. size: half the subject's, scene units"""
    if not (glass.absorption or glass.is_rough) or not _is_compiled():
        return {}
    import mitsuba as mi

    _register()
    rate = glass.absorption.rate if glass.absorption else (0.0, 0.0, 0.0)
    absorbing: dict[str, Any] = {"type": _NAME, "rate": mi.ScalarColor3f([part / size for part in rate])}
    if glass.is_rough:
        gain = 1.0 / kept_light(glass.roughness, glass.refraction)
        absorbing["gain"] = mi.TensorXf(gain)
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
        """Return the tint for light from outside, and times the absorption for light from inside.

        Both are multiplied by the gain (2, COSINES) of a rough surface, if there is one.
        """

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.rate = mi.Color3f(properties["rate"])
            self.tint = mi.Color3f(properties["tint"])
            self.gain = mi.Float(properties["gain"].array) if "gain" in properties else None

        def traverse(self, callback: Any) -> None:
            callback.put(RATE, self.rate, mi.ParamFlags.Differentiable)

        def eval(self, si: Any, active: Any = True) -> Any:
            inside = mi.Frame3f.cos_theta(si.wi) < 0.0
            left = self.tint * dr.select(inside, dr.exp(-self.rate * si.t), 1.0)
            return left if self.gain is None else left * self._gain(mi.Frame3f.cos_theta(si.wi), active)

        def _gain(self, cosine: Any, active: Any) -> Any:
            place = dr.minimum(dr.abs(cosine), 1.0) * (COSINES - 1)
            row = dr.minimum(mi.UInt32(place), COSINES - 2)
            first = row + dr.select(cosine < 0.0, COSINES, 0)
            low, high = (dr.gather(mi.Float, self.gain, first + step, active) for step in (0, 1))
            return dr.lerp(low, high, place - row)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"Absorbing[rate={self.rate}, tint={self.tint}]"

    mi.register_texture(_NAME, Absorbing)
