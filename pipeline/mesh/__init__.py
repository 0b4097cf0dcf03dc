"""Meshes: values, solids, files, connectivity, validation and normals.

Names are imported on first use: processes that read a model's file need no compiled kernel, and numba takes a
third of a second to import.
"""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
