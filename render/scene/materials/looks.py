"""The looks that a shot file can name: materials with their values."""

from __future__ import annotations

from render.scene.materials.material import Absorption, Material
from render.scene.materials.models import (
    BrushedMetal,
    Diffuse,
    Glass,
    Gouraud,
    Metal,
    Plastic,
    Satin,
    Smoke,
)
from render.scene.measure import Measure
from render.scene.patterns import Pigment

_MARBLE = Pigment(
    "marble",
    ((0.80, 0.79, 0.77), (0.085, 0.09, 0.105), (0.36, 0.35, 0.34)),
    scale=0.9,
    axis=(0.35, 1.0, 0.2),
    softness=0.75,
    share=0.2,
    turbulence=1.05,
    octaves=5,
    seed=3,
)
_SWIRL = Pigment(
    "layers",
    ((0.80, 0.74, 0.66), (0.66, 0.07, 0.12), (0.80, 0.74, 0.66), (0.80, 0.36, 0.42)),
    scale=0.17,
    axis=(0.25, 1.0, 0.1),
    softness=0.1,
    turbulence=0.6,
    octaves=1,
    seed=5,
)
"""Both suit a subject about 2 scene units across."""

LOOKS: dict[str, Material] = {
    "clay": Diffuse((0.73, 0.595, 0.46)),
    "putty": Satin((0.44, 0.41, 0.36), roughness=0.62, sheen=0.25, coat=0.0),
    "glaze": Plastic((0.38, 0.012, 0.008), roughness=0.055),
    "ceramic": Plastic((0.34, 0.50, 0.43), roughness=0.04),
    "chrome": Metal((0.80, 0.81, 0.82), roughness=0.04),
    "brushed": BrushedMetal((0.76, 0.74, 0.71), roughness=0.28),
    "taffy": Satin((0.80, 0.26, 0.34), roughness=0.32, sheen=0.5, metallic=0.2),
    "swirl": Satin((0.80, 0.74, 0.66), roughness=0.3, sheen=0.3, pigment=_SWIRL),
    "pearl": Satin((0.80, 0.76, 0.74), roughness=0.26, sheen=0.4, metallic=0.45),
    "marble": Plastic((0.80, 0.79, 0.77), roughness=0.13, pigment=_MARBLE),
    "cream": Plastic((0.82, 0.71, 0.53), roughness=0.22),
    "coffee": Plastic((0.045, 0.016, 0.006), roughness=0.07),
    "honey": Glass((1.0, 0.8, 0.36), refraction=1.49, absorption=Absorption((0.96, 0.72, 0.3), 0.4)),
    "glass": Glass((1.0, 1.0, 1.0), refraction=1.5, absorption=Absorption((0.80, 0.93, 0.89))),
    "smoke": Smoke((0.95, 0.95, 0.96), density=1.6),
    "speed": Satin((0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("speed")),
    "strain": Satin((0.5, 0.5, 0.5), roughness=0.6, coat=0.0, measure=Measure("stretch")),
    "symbolics_1990": Gouraud((0.95, 0.30, 0.03), roughness=0.3),
}
