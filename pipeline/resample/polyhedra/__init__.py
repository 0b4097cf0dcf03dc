"""Version 1 of the resampler (1990): polyhedra with faces of any number of sides."""

from pipeline.resample.polyhedra.polyhedral_resampler import PolyhedralReport, PolyhedralResampler

__all__ = ["PolyhedralReport", "PolyhedralResampler"]
