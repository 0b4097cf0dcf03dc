"""The named motions a shot can use (P3), a small file a family."""

from pipeline.flow.catalogue.attraction import Attraction, Target, Wind
from pipeline.flow.catalogue.attractors import Aizawa, Chen, Chua, Halvorsen, Lorenz, Rossler, Thomas
from pipeline.flow.catalogue.cellular import ABC, DoubleGyre, Enright, Kneading, TaylorGreen
from pipeline.flow.catalogue.deformations import Bend, Deformation, Shear, Stretch, Taper, Twist
from pipeline.flow.catalogue.expansion import Expansion, Sink, Source
from pipeline.flow.catalogue.formula import Formula
from pipeline.flow.catalogue.linear import Rotation, Scaling, Squeeze, Strain, Translation
from pipeline.flow.catalogue.noise import CurlNoise
from pipeline.flow.catalogue.sampled import Sampled, SampledFiles
from pipeline.flow.catalogue.vortices import SpiralVortex, Vortex, VortexPair, VortexRing

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
