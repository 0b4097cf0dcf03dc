"""Looks as values: materials, their patterns and textures, surfaces that have them, and lights."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
