"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
