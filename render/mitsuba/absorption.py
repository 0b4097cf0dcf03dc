"""Light that goes through a body is taken by the way inside (Beer 1852, Lambert 1760).

Compiled variants compute it: whenever light arrives at the surface from within, what it passes on to is
multiplied by exp(−rate · distance), exactly and without noise. Mitsuba's own way is a medium in which free
paths are drawn by chance; the plain variant, in which a texture of ours would be slow, takes that.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from render.scene.look import Look

_NAME = "flowsculpt_absorbing"

RATE = "absorption_rate"
"""The name of the texture's value among those of a scene."""


def textures(look: Look, size: float) -> dict[str, Any]:
    """What a dielectric transmits and reflects. size: half the subject's, scene units"""
    if look.absorption is None or not _is_compiled():
        return {}
    import mitsuba as mi

    _register()
    rate = mi.ScalarColor3f([part / size for part in look.absorption.rate])
    absorbing = {"type": _NAME, "rate": rate}
    return {
        "specular_transmittance": {**absorbing, "tint": mi.ScalarColor3f(look.colour)},
        "specular_reflectance": {**absorbing, "tint": mi.ScalarColor3f(1.0)},
    }


def medium(look: Look, size: float) -> dict[str, Any] | None:
    """What fills the surface where that does the work, or nothing."""
    if look.absorption is None or _is_compiled():
        return None
    strongest = max(*look.absorption.rate, 1e-9)
    shares = {"type": "rgb", "value": [part / strongest for part in look.absorption.rate]}
    return {"type": "homogeneous", "albedo": 0.0, "sigma_t": shares, "scale": strongest / size}


def path(look: Look) -> str:
    """The integrator that follows light through it."""
    return "volpathmis" if look.absorption is not None and not _is_compiled() else "path"


def _is_compiled() -> bool:
    import mitsuba as mi

    return mi.variant() != "scalar_rgb"


@cache
def _register() -> None:
    """Make the texture known to Mitsuba, whose classes are there once a variant is chosen."""
    import drjit as dr
    import mitsuba as mi

    class Absorbing(mi.Texture):
        """1 times the tint for light from outside; for light from within, what is left of it on its way."""

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
