"""The named motions a shot can use (P3), a small file a family."""

from pipeline.flow.catalogue.abc import ABC
from pipeline.flow.catalogue.aizawa import Aizawa
from pipeline.flow.catalogue.attraction import Attraction, Target
from pipeline.flow.catalogue.barr import Bend, Deformation, Shear, Stretch, Taper, Twist
from pipeline.flow.catalogue.chen import Chen
from pipeline.flow.catalogue.chua import Chua
from pipeline.flow.catalogue.curl_noise import CurlNoise
from pipeline.flow.catalogue.double_gyre import DoubleGyre
from pipeline.flow.catalogue.enright import Enright
from pipeline.flow.catalogue.expansion import Expansion
from pipeline.flow.catalogue.formula import Formula
from pipeline.flow.catalogue.halvorsen import Halvorsen
from pipeline.flow.catalogue.kneading import Kneading
from pipeline.flow.catalogue.lorenz import Lorenz
from pipeline.flow.catalogue.rossler import Rossler
from pipeline.flow.catalogue.rotation import Rotation
from pipeline.flow.catalogue.sampled import Sampled, SampledFiles
from pipeline.flow.catalogue.scaling import Scaling
from pipeline.flow.catalogue.source import Sink, Source
from pipeline.flow.catalogue.spiral_vortex import SpiralVortex
from pipeline.flow.catalogue.squeeze import Squeeze
from pipeline.flow.catalogue.strain import Strain
from pipeline.flow.catalogue.taylor_green import TaylorGreen
from pipeline.flow.catalogue.thomas import Thomas
from pipeline.flow.catalogue.translation import Translation
from pipeline.flow.catalogue.vortex import Vortex
from pipeline.flow.catalogue.vortex_pair import VortexPair
from pipeline.flow.catalogue.vortex_ring import VortexRing
from pipeline.flow.catalogue.wind import Wind

FLOWS: tuple[type, ...] = (
    Translation,
    Rotation,
    Scaling,
    Strain,
    Squeeze,
    Kneading,
    Vortex,
    VortexPair,
    VortexRing,
    SpiralVortex,
    Source,
    Sink,
    Expansion,
    ABC,
    TaylorGreen,
    DoubleGyre,
    Enright,
    Lorenz,
    Rossler,
    Aizawa,
    Thomas,
    Chua,
    Halvorsen,
    Chen,
    Twist,
    Taper,
    Stretch,
    Shear,
    Bend,
)
"""Every flow that is numbers only, in the order of the docs: simple ones, vortices, swelling, cells,
attractors, maps."""

__all__ = [
    "ABC",
    "FLOWS",
    "Aizawa",
    "Attraction",
    "Bend",
    "Chen",
    "Chua",
    "CurlNoise",
    "Deformation",
    "DoubleGyre",
    "Enright",
    "Expansion",
    "Formula",
    "Halvorsen",
    "Kneading",
    "Lorenz",
    "Rossler",
    "Rotation",
    "Sampled",
    "SampledFiles",
    "Scaling",
    "Shear",
    "Sink",
    "Source",
    "SpiralVortex",
    "Squeeze",
    "Strain",
    "Stretch",
    "Taper",
    "Target",
    "TaylorGreen",
    "Thomas",
    "Translation",
    "Twist",
    "Vortex",
    "VortexPair",
    "VortexRing",
    "Wind",
]
