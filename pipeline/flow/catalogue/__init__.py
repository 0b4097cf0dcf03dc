"""The named motions a shot can use (P3), a small file a family."""

from pipeline.flow.catalogue.barr import Deformation, Shear, Stretch, Taper, Twist
from pipeline.flow.catalogue.enright import Enright
from pipeline.flow.catalogue.expansion import Expansion
from pipeline.flow.catalogue.lorenz import Lorenz
from pipeline.flow.catalogue.rotation import Rotation
from pipeline.flow.catalogue.strain import Strain
from pipeline.flow.catalogue.translation import Translation
from pipeline.flow.catalogue.vortex import Vortex

__all__ = [
    "Deformation",
    "Enright",
    "Expansion",
    "Lorenz",
    "Rotation",
    "Shear",
    "Strain",
    "Stretch",
    "Taper",
    "Translation",
    "Twist",
    "Vortex",
]
