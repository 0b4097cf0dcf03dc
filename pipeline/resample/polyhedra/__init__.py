"""Version 1 of the resampler (1990): polyhedra with faces of any number of sides."""

from pipeline.resample.polyhedra.resampler import PolyhedralResampler
from pipeline.resample.report import PolyhedralReport

__all__ = ["PolyhedralReport", "PolyhedralResampler"]
