"""The look `marbling.inks`, and the encode `marbling.wall` for a wall of LEDs."""

from dataclasses import replace

from flowsculpt.api.materials import LOOKS, Pigment
from flowsculpt.api.pictures import ENCODES

MILK, INDIGO, OCHRE, MADDER = (
    (0.84, 0.80, 0.71),
    (0.015, 0.035, 0.13),
    (0.60, 0.29, 0.045),
    (0.34, 0.02, 0.025),
)

LAYERS = Pigment(
    "layers",
    (MILK, INDIGO, MILK, OCHRE, MILK, INDIGO, MADDER),
    scale=0.2,
    axis=(0.12, 0.0, 1.0),
    softness=0.05,
    turbulence=0.3,
    octaves=1,
    seed=4,
)

INKS = LOOKS["cream"].with_values(colour=MILK, roughness=0.06, pigment=LAYERS)

WALL = replace(ENCODES["h264"], name="wall", options={**ENCODES["h264"].options, "crf": "10"})
