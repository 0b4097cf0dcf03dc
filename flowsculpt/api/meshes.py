"""Meshes and their arrays; the resampler itself is in `flowsculpt`."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
