"""Absorption inside clear bodies (Beer 1852, Lambert 1760), and light that rough ones would lose.

In compiled variants a texture of ours computes both. Where light reaches the surface from inside, it is
multiplied by exp(−rate · distance), exactly and without noise; and by what makes up for the loss of a rough
surface (`kept_light`). The scalar variant, in which such a texture is slow, uses Mitsuba's medium, which
samples free paths, and leaves the loss.

A rough dielectric loses light, since its BSDF leaves out scattering between microfacets: a GGX interface of
roughness 0.3 loses a tenth of it at each passage (Heitz, Hanika, d'Eon and Dachsbacher, *Multiple-scattering
microfacet BSDFs with the Smith model*, 2016). Dividing the BSDF by the light that it keeps from each
direction gives that light back, as Blender's Cycles does.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.materials import Glass

_NAME = "flowsculpt_absorbing"

RATE = "absorption_rate"
"""Name of the texture's rate among the parameters of a scene."""

COSINES = 32
"""Rows of the table of kept light: cosines of the angle to the normal, evenly from 0 to 1."""

_SAMPLES = 64
"""Samples of a row are the square of this."""


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


@lru_cache(maxsize=16)
def kept_light(roughness: float, refraction: float) -> NDArray[np.float32]:
    """Return the fraction of light (2, COSINES) that the interface keeps, from outside and from inside.

    Needs a started engine of a compiled variant.
    """
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict(
        {"type": "roughdielectric", "alpha": roughness, "int_ior": refraction, "distribution": "ggx"}
    )
    cosines = np.linspace(0.0, 1.0, COSINES)
    cosines[0] = 0.25 / COSINES
    cosine = np.repeat(np.concatenate([cosines, -cosines]), _SAMPLES**2).astype(np.float32)
    places = (np.stack(np.meshgrid(*2 * [np.arange(_SAMPLES)]), axis=-1).reshape(-1, 2) + 0.5) / _SAMPLES
    x, y = np.tile(places, (2 * COSINES, 1)).T.astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(cosine))
    si.wi = mi.Vector3f(mi.Float(np.sqrt(1.0 - cosine**2)), 0.0, mi.Float(cosine))
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    # The lobe is chosen by a number that is even on its own: the golden ratio's multiples.
    lobe = mi.Float((np.arange(len(cosine)) * 0.6180339887498949 % 1.0).astype(np.float32))
    _, weight = bsdf.sample(mi.BSDFContext(mi.TransportMode.Importance), si, lobe, mi.Point2f(x, y))
    return np.array(weight.x).reshape(2, COSINES, -1).mean(axis=2)


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
