"""Flows: mappings of points into points, their composition and their keyframes."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
